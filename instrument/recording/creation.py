"""Creates a session file, whole or not at all."""

from __future__ import annotations

from pathlib import Path

from instrument.files.new_hdf5 import new_hdf5
from instrument.files.whole_file import check_space, written_whole
from instrument.recording.header import SessionHeader
from instrument.recording.tree import write_tree

# The oldest format with checksums on its own bookkeeping, and the newest that opens after a kill: the
# next one marks a file that is being written, and refuses it afterwards.
HDF5_FORMAT = ("v108", "v108")

# Bytes that are made sure of for a file without frames: its tables, previews and darks.
_MIN_START, _MAX_START = 2**18, 2**28


class SessionExistsError(FileExistsError):
    """A capture would overwrite a file."""


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
    room = min(max(planned_bytes, _MIN_START), _MAX_START)
    with written_whole(path) as part, new_hdf5(part, room, HDF5_FORMAT) as file:
        write_tree(file, header)


def refuse_existing(path: Path) -> None:
    """Raise `SessionExistsError` if there is anything at `path`."""
    if path.exists():
        raise SessionExistsError(
            f"{path} exists and is not overwritten. Choose another name, or go on with it: halfangle resume {path}"
        )
