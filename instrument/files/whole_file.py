"""Writes files whole or not at all: under a temporary name, flushed, then renamed.

Whatever fails on the way, nothing stays: neither half a file under the final name nor the temporary one
(docs/decisions/0022). HDF5 files are written into it by `instrument.files.new_hdf5`.
"""

from __future__ import annotations

import errno
import os
import re
import secrets
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from instrument.files.validation import InvalidInputError, Problem

NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)
"""What a disk answers that has no room."""

NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP)
"""What a file system answers that has no locks."""

_WHY = {
    errno.ENOSPC: ("disk full", "Free some space or choose another disk"),
    errno.EDQUOT: ("disk full, as far as a quota allows", "Free some space or choose another disk"),
    errno.EFBIG: ("larger than a limit or the file system allows", "Choose another disk"),
    errno.EROFS: ("its file system can only be read", "Choose another folder"),
    errno.EACCES: ("there is no permission to write in its folder", "Choose another folder, or ask for permission"),
    errno.EPERM: ("there is no permission to write in its folder", "Choose another folder, or ask for permission"),
    errno.ENAMETOOLONG: ("its name is too long", "Choose a shorter one"),
    errno.EIO: ("the disk fails", "Choose another disk, and have this one checked"),
    errno.ENOLCK: (
        "its file system has no locks",
        "Set the environment variable HDF5_USE_FILE_LOCKING=FALSE if no other program uses the file, then try again",
    ),
}

# File systems without hard links; a name is taken there in another way.
_NO_LINKS = (errno.EPERM, errno.ENOTSUP, errno.EOPNOTSUPP, errno.ENOSYS, errno.EMLINK, errno.EACCES, errno.EXDEV)

# A name may have 255 bytes, and a character up to four.
_KEPT_CHARACTERS = 40


class NotWrittenError(OSError):
    """A file was not written; the text says which, why, how much room was needed and what to do next."""

    def __str__(self) -> str:
        return str(self.strerror)


class InsufficientSpaceError(NotWrittenError):
    """The disk cannot hold what is planned."""


@contextmanager
def written_whole(path: Path, *, overwrite: bool = False, n_bytes: int | None = None) -> Iterator[Path]:
    """Give the temporary name to write a file or a folder at; after the block it has the name `path`.

    A check of what was written belongs at the end of the block: what it raises keeps the file from appearing.

    Parameters
    ----------
    path : Path
    overwrite : bool
        Takes the place of a file that is there, in one step.
    n_bytes : int, optional
        Size of the file, for the message if there is no room.

    Yields
    ------
    Path
        Hidden, in the same folder, with nothing at that place yet.

    Raises
    ------
    FileExistsError
        If there is something at `path`, now or at the end, and it is not to be overwritten.
    NotWrittenError
        If the disk or its folder does not take it.
    """
    if not overwrite:
        _refuse_existing(path)
    if not path.parent.is_dir():
        raise NotWrittenError(errno.ENOENT, f"{path} is not written: {path.parent} is no folder. Make it first")
    place = path.resolve() if overwrite else path
    part = place.with_name(f".{path.name[:_KEPT_CHARACTERS]}.{os.getpid()}-{secrets.token_hex(3)}.part")
    try:
        yield part
        _sync(part)
        _rename(part, place, overwrite=overwrite)
    except (OSError, RuntimeError) as error:
        written = _size(part)
        # What it took is free again before it is said how much is.
        _remove(part)
        explained = _explained(error, path, part, n_bytes, written)
        if explained is error:
            raise
        raise explained from error
    finally:
        _remove(part)


def write_whole(path: Path, content: str | bytes, *, overwrite: bool = False) -> None:
    """Write a file whose content is at hand, text as UTF-8.

    Raises
    ------
    FileExistsError
        If there is something at `path` and it is not to be overwritten.
    NotWrittenError
        If the disk or its folder does not take it.
    """
    data = content.encode() if isinstance(content, str) else content
    with written_whole(path, overwrite=overwrite, n_bytes=len(data)) as part, part.open("xb") as file:
        file.write(data)


def refuse_unreadable(path: Path, part: Path, read: Callable[[Path], object]) -> None:
    """Read a file as its reader will, before it has its name.

    Parameters
    ----------
    path : Path
        Its name.
    part : Path
        Its temporary name.
    read : callable
        Takes the temporary name.

    Raises
    ------
    InvalidInputError
        With what the reader finds wrong.
    """
    try:
        read(part)
    except InvalidInputError as error:
        problems = [
            Problem(*(text.replace(str(part), str(path)) for text in (p.where, p.what))) for p in error.problems
        ]
        raise InvalidInputError(f"{path} is not written: it could not be read again", problems) from None


def check_space(path: Path, planned_bytes: int) -> None:
    """Raise `InsufficientSpaceError` unless `planned_bytes` and a tenth more fit beside `path`."""
    needed = int(1.1 * planned_bytes)
    if shutil.disk_usage(path.parent).free < needed:
        raise no_room(path, errno.ENOSPC, f"up to {size_text(needed)}")


def no_room(path: Path, number: int, needed: str) -> InsufficientSpaceError:
    """Return the error of a file that does not fit, with what it needs in words and what is free beside it."""
    why, advice = _WHY[number]
    with suppress(OSError):
        free = size_text(shutil.disk_usage(path.parent).free)
        why = f"{why}; it needs {needed}, and {free} are free"
    return InsufficientSpaceError(number, f"{path} is not written: {why}. {advice}")


def size_text(n_bytes: int) -> str:
    """Return a size as one reads it, such as 64 kB or 1.3 GB."""
    for unit, size in (("GB", 1e9), ("MB", 1e6)):
        if n_bytes >= size:
            return f"{n_bytes / size:.1f} {unit}"
    return f"{n_bytes / 1e3:.0f} kB" if n_bytes >= 1e4 else f"{n_bytes} bytes"


def system_number(error: Exception) -> int | None:
    """Return the number that the system gave for an error; libraries hide it in their text."""
    if isinstance(error, OSError) and error.errno is not None:
        return error.errno
    hidden = re.search(r"errno = (\d+)", str(error))
    if hidden:
        return int(hidden.group(1))
    return next((number for number in _WHY if os.strerror(number) in str(error)), None)


def _explained(error: Exception, path: Path, part: Path, n_bytes: int | None, written: int) -> Exception:
    """Return an error of writing with the file's name and what to do next; any other as it is."""
    if isinstance(error, NotWrittenError):
        # Of a file inside, or of one that was written on the way to this one.
        return type(error)(error.errno, str(error).replace(str(part), str(path)).replace(part.name, path.name))
    number = system_number(error)
    of = getattr(error, "filename", None)
    if number not in _WHY or not (of is None or Path(os.fsdecode(of)).is_relative_to(part)):
        return error
    if number in NO_ROOM:
        return no_room(path, number, f"more than {size_text(written)}" if n_bytes is None else size_text(n_bytes))
    why, advice = _WHY[number]
    return NotWrittenError(number, f"{path} is not written: {why}. {advice}")


def _refuse_existing(path: Path) -> None:
    if os.path.lexists(path):
        raise FileExistsError(f"{path} exists and is not overwritten; choose another name")


def _size(part: Path) -> int:
    files = part.rglob("*") if part.is_dir() else [part]
    return sum(file.stat().st_size for file in files if file.is_file())


def _remove(part: Path) -> None:
    # A folder that can no more be written must not hide why.
    with suppress(OSError):
        if part.is_dir():
            shutil.rmtree(part, ignore_errors=True)
        else:
            part.unlink(missing_ok=True)


def _sync(part: Path) -> None:
    """Hand a file to the disk, not only to the operating system: some file systems find out now that it is full."""
    if part.is_dir():
        _sync_folder(part)
        return
    with part.open("r+b") as file:
        os.fsync(file.fileno())


def _sync_folder(folder: Path) -> None:
    # Not every system opens folders, and not every file system syncs them.
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _rename(part: Path, place: Path, *, overwrite: bool) -> None:
    if overwrite:
        part.replace(place)
    elif part.is_dir():
        # A folder takes the place of an empty one at most.
        _refuse_existing(place)
        part.rename(place)
    else:
        _take_name(part, place)
    _sync_folder(place.parent)


def _take_name(part: Path, place: Path) -> None:
    """Rename unless somebody else has written a file of that name meanwhile."""
    try:
        # A plain rename would overwrite it.
        os.link(part, place)
    except FileExistsError:
        _refuse_existing(place)
        raise
    except OSError as error:
        if error.errno not in _NO_LINKS:
            raise
        _claim(place)
        part.replace(place)


def _claim(place: Path) -> None:
    """Take a name with an empty file, which only one writer can do, where there are no hard links."""
    try:
        place.open("xb").close()
    except FileExistsError:
        _refuse_existing(place)
        raise
