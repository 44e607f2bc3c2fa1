"""A file appears under its name whole, checked and on the disk, or not at all."""

from __future__ import annotations

import errno
import os
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from instrument.files import whole_file
from instrument.files.validation import InvalidInputError, Problem
from instrument.files.whole_file import (
    InsufficientSpaceError,
    NotWrittenError,
    check_space,
    refuse_unreadable,
    size_text,
    write_whole,
    written_whole,
)
from tests.small_disk import fill, small_disk


def names(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir()]


def written(path: Path, *acts: Callable[[Path], object]) -> None:
    """Do something with the temporary name, one after the other."""
    with written_whole(path) as part:
        for act in acts:
            act(part)


def raising(error: BaseException) -> Callable[[Path], None]:
    def act(_: Path) -> None:
        raise error

    return act


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    with small_disk(tmp_path / "disk", "64k") as folder:
        yield folder


@pytest.mark.parametrize("content", ["Größe 3 µm\n", b"\0\xff"])
def test_what_is_written_is_there_and_nothing_else(tmp_path: Path, content: str | bytes) -> None:
    write_whole(tmp_path / "a.txt", content)
    assert (tmp_path / "a.txt").read_bytes() == (content.encode() if isinstance(content, str) else content)
    assert names(tmp_path) == ["a.txt"]


def test_until_the_block_ends_the_name_is_free(tmp_path: Path) -> None:
    with written_whole(tmp_path / "a.h5") as part:
        part.write_bytes(b"half")
        assert part.parent == tmp_path
        assert part.name.startswith(".a.h5.")
        # A program that looks for files by their ending must not take it for one.
        assert list(tmp_path.glob("*.h5")) == []
    assert (tmp_path / "a.h5").read_bytes() == b"half"


@pytest.mark.parametrize("error", [ValueError("no"), KeyboardInterrupt(), OSError(errno.ENOENT, "no", "else.h5")])
def test_an_error_leaves_nothing_and_is_what_it_was(tmp_path: Path, error: BaseException) -> None:
    with pytest.raises(type(error)) as caught:
        written(tmp_path / "a.h5", lambda part: part.write_bytes(b"half"), raising(error))
    assert caught.value is error
    assert names(tmp_path) == []


def test_a_file_that_is_there_is_kept(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("mine")
    with pytest.raises(FileExistsError, match=r"a exists and is not overwritten; choose another name"):
        write_whole(tmp_path / "a", "yours")
    assert (tmp_path / "a").read_text() == "mine"


def test_a_link_to_nothing_is_kept(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to(tmp_path / "nowhere")
    with pytest.raises(FileExistsError, match="not overwritten"):
        write_whole(tmp_path / "a", "yours")
    assert not (tmp_path / "nowhere").exists()


@pytest.mark.parametrize("has_links", [True, False])
def test_of_two_writers_of_one_name_the_first_to_end_wins(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_links: bool
) -> None:
    if not has_links:
        monkeypatch.setattr(os, "link", _refusing(errno.EPERM))
    path = tmp_path / "a"
    with pytest.raises(FileExistsError, match="not overwritten"):
        written(path, lambda part: part.write_text("slow"), lambda _: write_whole(path, "fast"))
    assert (tmp_path / "a").read_text() == "fast"
    assert names(tmp_path) == ["a"]


def test_without_hard_links_a_file_is_whole_all_the_same(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(os, "link", _refusing(errno.ENOTSUP))
    write_whole(tmp_path / "a", "text")
    assert (tmp_path / "a").read_text() == "text"
    assert names(tmp_path) == ["a"]


def test_what_may_be_overwritten_is_there_until_the_new_file_takes_its_place(tmp_path: Path) -> None:
    (tmp_path / "a").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "a")
    with written_whole(tmp_path / "link", overwrite=True) as part:
        part.write_text("new")
        assert (tmp_path / "a").read_text() == "old"
    assert (tmp_path / "a").read_text() == "new"
    assert (tmp_path / "link").is_symlink()


def test_a_folder_appears_with_all_that_is_in_it_or_goes(tmp_path: Path) -> None:
    with written_whole(tmp_path / "made") as part:
        part.mkdir()
        write_whole(part / "a", "text")
    assert (tmp_path / "made" / "a").read_text() == "text"
    with pytest.raises(ValueError, match="no"):
        written(
            tmp_path / "other",
            Path.mkdir,
            lambda part: write_whole(part / "a", "text"),
            raising(ValueError("no")),
        )
    assert names(tmp_path) == ["made"]


def test_a_folder_takes_no_place_that_was_taken_meanwhile(tmp_path: Path) -> None:
    with pytest.raises(FileExistsError, match="not overwritten"):
        written(tmp_path / "made", Path.mkdir, lambda _: (tmp_path / "made").mkdir())
    assert names(tmp_path) == ["made"]


def test_it_is_handed_to_the_disk_before_it_has_its_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    synced: list[bool] = []
    fsync = os.fsync

    def watched(descriptor: int) -> None:
        synced.append((tmp_path / "a").exists())
        fsync(descriptor)

    monkeypatch.setattr(os, "fsync", watched)
    write_whole(tmp_path / "a", "text")
    # The file without its name, then the folder with it.
    assert synced == [False, True]


def test_a_long_name_leaves_room_for_the_temporary_one(tmp_path: Path) -> None:
    name = "ß" * 120 + ".html"
    write_whole(tmp_path / name, "text")
    assert names(tmp_path) == [name]


def test_a_full_disk_is_told_with_name_need_and_room(disk: Path) -> None:
    fill(disk, 20 * 1024)
    with pytest.raises(InsufficientSpaceError) as caught:
        write_whole(disk / "page.html", bytes(50_000))
    assert str(caught.value) == (
        f"{disk / 'page.html'} is not written: disk full; it needs 50 kB, and 20 kB are free. "
        "Free some space or choose another disk"
    )
    assert names(disk) == ["others"]


def test_where_the_size_is_not_known_what_was_written_is_told(disk: Path) -> None:
    def write_on(part: Path) -> None:
        with part.open("wb") as file:
            for _ in range(100):
                file.write(bytes(4096))

    with pytest.raises(InsufficientSpaceError, match=r"it needs more than 6\d kB, and 6\d kB are free"):
        written(disk / "a", write_on)
    assert names(disk) == []


def test_in_a_folder_the_file_that_failed_is_named_by_its_final_place(disk: Path) -> None:
    with pytest.raises(InsufficientSpaceError, match=rf"^{disk}/made/a\.dng is not written: disk full"):
        written(disk / "made", Path.mkdir, lambda part: write_whole(part / "a.dng", bytes(70_000)))
    assert names(disk) == []


@pytest.mark.parametrize(
    ("number", "message"),
    [
        (errno.EDQUOT, "disk full, as far as a quota allows; it needs 4"),
        (errno.EROFS, "its file system can only be read. Choose another folder"),
        (errno.EACCES, "there is no permission to write in its folder"),
        (errno.EIO, "the disk fails"),
        (errno.ENOLCK, "its file system has no locks. Set the environment variable HDF5_USE_FILE_LOCKING=FALSE"),
    ],
)
def test_each_refusal_of_the_system_says_why_and_what_next(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, number: int, message: str
) -> None:
    monkeypatch.setattr(whole_file, "_sync", _refusing(number))
    with pytest.raises(NotWrittenError) as caught:
        write_whole(tmp_path / "a.json", "text")
    assert str(caught.value).startswith(f"{tmp_path / 'a.json'} is not written: {message}")
    assert caught.value.errno == number
    assert names(tmp_path) == []


@pytest.mark.parametrize(
    "error",
    [
        RuntimeError('Failed to write pixel data to image file "/x/y.exr". No space left on device.'),
        OSError("Unable to write (file write failed: time = now, errno = 28, error message = 'No space')"),
        OSError(errno.ENOSPC, "No space left on device"),
    ],
)
def test_an_error_that_a_library_words_in_its_own_way_is_understood(tmp_path: Path, error: Exception) -> None:
    with pytest.raises(InsufficientSpaceError, match=r"a\.exr is not written: disk full"):
        written(tmp_path / "a.exr", raising(error))


def test_a_source_that_cannot_be_read_is_not_blamed_on_the_target(tmp_path: Path) -> None:
    with pytest.raises(PermissionError, match=r"other\.h5"):
        written(tmp_path / "a.h5", raising(PermissionError(errno.EACCES, "Permission denied", "other.h5")))


def test_a_folder_that_is_missing_is_named(tmp_path: Path) -> None:
    with pytest.raises(NotWrittenError, match=rf"a is not written: {tmp_path}/no is no folder. Make it first"):
        write_whole(tmp_path / "no" / "a", "text")


def test_what_its_reader_refuses_is_not_written(tmp_path: Path) -> None:
    def read(path: Path) -> None:
        raise InvalidInputError("title", [Problem(str(path), f"{path} has no maps"), Problem("/entry", "missing")])

    path = tmp_path / "a.result.h5"
    with pytest.raises(InvalidInputError) as caught:
        written(path, lambda part: part.write_text("text"), lambda part: refuse_unreadable(path, part, read))
    assert str(caught.value).splitlines() == [
        f"{path} is not written: it could not be read again",
        f"  {path}: {path} has no maps",
        "  /entry: missing",
    ]
    assert names(tmp_path) == []


def test_room_is_asked_for_with_a_tenth_more(disk: Path) -> None:
    check_space(disk / "a", 50_000)
    with pytest.raises(InsufficientSpaceError, match=r"a is not written: disk full; it needs up to 66 kB, and 66 kB"):
        check_space(disk / "a", 60_000)


def test_sizes_read_as_one_says_them() -> None:
    sizes = (700, 9_999, 10_000, 65_536, 1_300_000, 48 * 10**9)
    assert [size_text(n) for n in sizes] == ["700 bytes", "9999 bytes", "10 kB", "66 kB", "1.3 MB", "48.0 GB"]


def _refusing(number: int) -> Callable[..., None]:
    def refuse(*_: object) -> None:
        raise OSError(number, os.strerror(number))

    return refuse
