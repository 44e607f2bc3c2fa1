"""Brings a session file into the world, whole or not at all, and hands its bytes to the disk."""

from __future__ import annotations

import errno
import os
import shutil
from pathlib import Path

import h5py

from instrument.recording.header import SessionHeader
from instrument.recording.tree import write_tree

# The oldest format with checksums on its own bookkeeping, and the newest that opens after a kill: the
# next one marks a file that is being written, and refuses it afterwards.
HDF5_FORMAT = ("v108", "v108")

# Bytes that are made sure of for a file without frames: its tables, previews and darks.
_MIN_START, _MAX_START = 2**18, 2**28

# What a disk says that has no room; anything else means that its file system cannot promise any.
_NO_ROOM = (errno.ENOSPC, errno.EFBIG, errno.EDQUOT)


class SessionExistsError(FileExistsError):
    """A capture would overwrite a file."""


class InsufficientSpaceError(OSError):
    """The disk cannot hold what is planned."""


def create_session(path: Path, header: SessionHeader, planned_bytes: int) -> None:
    """Write a session without frames at `path`; it appears there whole or not at all.

    Raises
    ------
    SessionExistsError
        If there is a file at `path`.
    InsufficientSpaceError
        If the disk cannot hold the plan and a tenth more.
    """
    refuse_existing(path)
    check_space(path, planned_bytes)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with h5py.File(part, "w", libver=HDF5_FORMAT) as file:
            reserve(file, min(max(planned_bytes, _MIN_START), _MAX_START))
            write_tree(file, header)
            sync(file)
            release(file)
        part.rename(path)
    finally:
        part.unlink(missing_ok=True)


def refuse_existing(path: Path) -> None:
    """Raise `SessionExistsError` if there is anything at `path`."""
    if path.exists():
        raise SessionExistsError(
            f"{path} exists and is not overwritten. Choose another name, or go on with it: halfangle resume {path}"
        )


def check_space(path: Path, planned_bytes: int) -> None:
    """Raise `InsufficientSpaceError` unless `planned_bytes` and a tenth more fit beside `path`."""
    free, needed = shutil.disk_usage(path.parent).free, int(1.1 * planned_bytes)
    if free < needed:
        raise InsufficientSpaceError(
            errno.ENOSPC,
            f"{path.parent} has {free / 1e6:.0f} MB free; the capture needs up to {needed / 1e6:.0f} MB. "
            "Free some space or choose another disk",
        )


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
    # Without this call (not on Linux) only `check_space` stands between a full disk and the file.
    if not hasattr(os, "posix_fallocate"):
        return
    descriptor = file.id.get_vfd_handle()
    try:
        os.posix_fallocate(descriptor, os.fstat(descriptor).st_size, n_bytes)
    except OSError as error:
        release(file)
        if error.errno not in _NO_ROOM:
            return
        why = f"there is no room for the next {n_bytes / 1e6:.1f} MB: {error.strerror}. Free some space, then go on"
        raise InsufficientSpaceError(error.errno, why) from None


def release(file: h5py.File) -> None:
    """Give back what was reserved and not used; nothing may have been written since the last `sync`."""
    os.ftruncate(file.id.get_vfd_handle(), file.id.get_filesize())
