"""HDF5 is given its room before it writes, so that a full disk never reaches it."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from instrument.files import new_hdf5 as module
from instrument.files.new_hdf5 import BOOKKEEPING_BYTES, n_abandoned, new_hdf5
from instrument.files.whole_file import InsufficientSpaceError, NotWrittenError, written_whole
from tests.small_disk import fill, small_disk


@pytest.fixture
def disk(tmp_path: Path) -> Iterator[Path]:
    with small_disk(tmp_path / "disk", "256k") as folder:
        yield folder


def write(path: Path, values: np.ndarray[tuple[int], np.dtype[np.float64]]) -> None:
    with written_whole(path) as part, new_hdf5(part, values.nbytes + BOOKKEEPING_BYTES) as file:
        file["values"] = values


def test_a_file_takes_no_more_room_than_it_has_values(tmp_path: Path) -> None:
    values = np.arange(1000.0)
    write(tmp_path / "a.h5", values)
    status = (tmp_path / "a.h5").stat()
    assert status.st_size < values.nbytes + BOOKKEEPING_BYTES
    assert status.st_blocks * 512 <= status.st_size + 8192
    with h5py.File(tmp_path / "a.h5") as file:
        np.testing.assert_array_equal(file["values"], values)


def test_without_room_hdf5_is_not_touched(disk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fill(disk, 100_000)
    monkeypatch.setattr(h5py, "File", None)
    with pytest.raises(
        InsufficientSpaceError, match=r"a\.h5 is not written: disk full; it needs up to 113 kB, and 9\d"
    ):
        write(disk / "a.h5", np.zeros(10_000))
    assert list(disk.iterdir()) == [disk / "others"]


def test_what_others_write_meanwhile_does_not_take_the_room(disk: Path) -> None:
    values = np.arange(15_000.0)
    with written_whole(disk / "a.h5") as part, new_hdf5(part, values.nbytes + BOOKKEEPING_BYTES) as file:
        with pytest.raises(OSError, match="No space left"):
            (disk / "others").write_bytes(bytes(200_000))
        file["values"] = values
    with h5py.File(disk / "a.h5") as file:
        np.testing.assert_array_equal(file["values"], values)


def test_an_error_of_ours_closes_the_file_and_leaves_nothing(tmp_path: Path) -> None:
    before = n_abandoned()
    with pytest.raises(KeyboardInterrupt), written_whole(tmp_path / "a.h5") as part, new_hdf5(part, 10_000) as file:
        raise KeyboardInterrupt
    assert not file
    assert n_abandoned() == before
    assert list(tmp_path.iterdir()) == []


def test_a_file_in_which_hdf5_fails_is_abandoned_and_goes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "_ABANDONED", [])
    error = OSError("Unable to write (file write failed: errno = 28, error message = 'No space left on device')")
    full = pytest.raises(InsufficientSpaceError, match=r"a\.h5 is not written: disk full")
    with full, written_whole(tmp_path / "a.h5") as part, new_hdf5(part, 10_000):
        raise error
    assert n_abandoned() == 1
    assert list(tmp_path.iterdir()) == []


def test_a_file_system_without_locks_leaves_nothing_and_says_what_to_set(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_locks(path: Path, *_: object, **__: object) -> None:
        # HDF5 makes the file before it finds that it cannot lock it.
        path.touch()
        raise OSError(errno.ENOLCK, "Unable to synchronously create file (unable to lock file, errno = 37)")

    monkeypatch.setattr(h5py, "File", no_locks)
    with pytest.raises(NotWrittenError, match=r"a\.h5 is not written: .* no locks\. .* HDF5_USE_FILE_LOCKING=FALSE"):
        write(tmp_path / "a.h5", np.zeros(10))
    assert list(tmp_path.iterdir()) == []
