"""Reads a truncated session, as after a power loss, without changing a byte of it."""

from __future__ import annotations

import io
import struct
from pathlib import Path

import h5py

SIGNATURE = b"\x89HDF\r\n\x1a\n"

# Where each version of HDF5's superblock holds the size that the file should have.
_END_OF_FILE_AT = {0: 40, 1: 44, 2: 28, 3: 28}

_SUPERBLOCK_BYTES = 64


class PaddedFile(io.RawIOBase):
    """A file with zeros in place of its missing end.

    Parameters
    ----------
    path : Path
    size : int
        Bytes that there should be.
    """

    def __init__(self, path: Path, size: int) -> None:
        super().__init__()
        self._file, self._size, self._at = path.open("rb"), size, 0

    def readable(self) -> bool:
        """Return True."""
        return True

    def seekable(self) -> bool:
        """Return True."""
        return True

    def seek(self, offset: int, whence: int = io.SEEK_SET, /) -> int:
        """Go to a byte, also one that is missing."""
        self._at = offset + {io.SEEK_SET: 0, io.SEEK_CUR: self._at, io.SEEK_END: self._size}[whence]
        return self._at

    def tell(self) -> int:
        """Return where the next byte is read."""
        return self._at

    def readinto(self, buffer: bytearray | memoryview) -> int:  # type: ignore[override]
        """Fill `buffer` with what is there, and zeros."""
        n = max(0, min(len(buffer), self._size - self._at))
        self._file.seek(self._at)
        found = self._file.read(n)
        buffer[:n] = found + bytes(n - len(found))
        self._at += n
        return n

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()


def missing_bytes(path: Path) -> tuple[int, int]:
    """Return how many bytes a file lacks at its end, and how many it should have; (0, 0) if that cannot be told."""
    with path.open("rb") as file:
        head = file.read(_SUPERBLOCK_BYTES)
    at = _END_OF_FILE_AT.get(head[8] if len(head) == _SUPERBLOCK_BYTES and head.startswith(SIGNATURE) else -1)
    if at is None:
        return 0, 0
    (size,) = struct.unpack_from("<Q", head, at)
    return max(0, size - path.stat().st_size), size


def open_cut_short(path: Path, size: int) -> h5py.File:
    """Open what is left of a session of `size` bytes; raises what h5py raises if nothing can be read."""
    return h5py.File(PaddedFile(path, size), "r")
