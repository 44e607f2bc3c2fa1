"""Writes HDF5 so that a full disk crashes nothing: its room is taken from the disk first (docs/decisions/0017)."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py

from instrument.files.whole_file import NO_ROOM, InsufficientSpaceError, no_room, size_text

# Files in which a write failed. HDF5 can neither write such a file any more nor close it without a risk of crashing the
# program, so they stay open to its end; what was complete is on the disk.
_ABANDONED: list[h5py.File] = []

BOOKKEEPING_BYTES = 2**15
"""Room for HDF5's own tables in a small file, besides its values; a large one takes a tenth of them more."""


def n_abandoned() -> int:
    """Return how many files of this process were abandoned after a failed write: HDF5 may crash at its regular end."""
    return len(_ABANDONED)


def abandon(file: h5py.File) -> None:
    """Touch a file in which a write failed no more; what is complete is on the disk."""
    _ABANDONED.append(file)


@contextmanager
def new_hdf5(path: Path, n_bytes: int, libver: tuple[str, str] | None = None) -> Iterator[h5py.File]:
    """Give a new HDF5 file to write into, closed and on the disk after the block.

    Parameters
    ----------
    path : Path
        Temporary name, as `instrument.files.whole_file.written_whole` gives it.
    n_bytes : int
        How large the file becomes, at most.
    libver : (str, str), optional
        Oldest and newest format, as h5py takes them.

    Raises
    ------
    InsufficientSpaceError
        If the disk, or a quota, does not have so much room; HDF5 has not touched it then.
    OSError, RuntimeError
        If HDF5 cannot write it all the same.
    """
    _try_room(path, n_bytes)
    file = h5py.File(path, "w", libver=libver)
    try:
        reserve(file, n_bytes)
        yield file
        sync(file)
        release(file)
        file.close()
    except (OSError, RuntimeError):
        abandon(file)
        raise
    except BaseException:
        # Nothing of HDF5 failed, and what it has still to write has room.
        file.close()
        raise


def sync(file: h5py.File) -> None:
    """Hand everything to the disk, not only to the operating system."""
    file.flush()
    os.fsync(file.id.get_vfd_handle())


def reserve(file: h5py.File, n_bytes: int) -> None:
    """Take room from the disk before HDF5 needs it: a write of its own that fails can leave a file that never opens.

    Parameters
    ----------
    file : h5py.File
        Open to write, with nothing written since the last `sync`.
    n_bytes : int
        What is written next, at most.

    Raises
    ------
    InsufficientSpaceError
        If the disk, or a quota, does not give it; the file is as it was.
    """
    number = _taken(file.id.get_vfd_handle(), n_bytes)
    if number is not None:
        release(file)
        why = f"there is no room for the next {size_text(n_bytes)}: {os.strerror(number)}. Free some space, then go on"
        raise InsufficientSpaceError(number, f"{file.filename}: {why}")


def release(file: h5py.File) -> None:
    """Give back what was reserved and not used; nothing may have been written since the last `sync`."""
    os.ftruncate(file.id.get_vfd_handle(), file.id.get_filesize())


def _try_room(path: Path, n_bytes: int) -> None:
    """Raise unless there is room: HDF5 needs some even to close a file that it has just made."""
    try:
        with path.open("xb") as file:
            number = _taken(file.fileno(), n_bytes)
    finally:
        path.unlink(missing_ok=True)
    if number is not None:
        raise no_room(path, number, f"up to {size_text(n_bytes)}")


def _taken(descriptor: int, n_bytes: int) -> int | None:
    """Take room beyond the end of a file; return the system's number if there is none."""
    # Without this call (not on Linux) only `check_space` stands between a full disk and the file.
    if not hasattr(os, "posix_fallocate"):
        return None
    try:
        os.posix_fallocate(descriptor, os.fstat(descriptor).st_size, n_bytes)
    except OSError as error:
        # Anything else means that the file system cannot promise any room.
        return error.errno if error.errno in NO_ROOM else None
    return None
