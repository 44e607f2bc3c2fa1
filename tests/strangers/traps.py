"""Sessions that are known to end, or to hold for ever, whoever reads them."""

import struct
from pathlib import Path

import h5py
import numpy as np

from instrument.session import layout


def crashing(path: Path, i_pose: int = 1) -> None:
    """Let the packed first frame of a pose say that it is 2 GiB long, which bitshuffle believes."""
    with h5py.File(path, "r+") as file:
        chunk = struct.pack(">QII", 768, 64, 2**31 - 1) + bytes(600)
        file[layout.IMAGES.path].id.write_direct_chunk((i_pose, 0, 0, 0), chunk, 0)


def endless(path: Path) -> None:
    """Let the second text in HDF5's heap have no length: HDF5 goes on to the next one, which is the same."""
    content = bytearray(path.read_bytes())
    at = content.index(b"GCOL") + 40
    content[at : at + 16] = bytes(16)
    path.write_bytes(content)


def filling(path: Path) -> None:
    """Let hundreds of lines of the journal be one and the same of a megabyte."""
    n, size_of_a_reference = 300, 16
    with h5py.File(path, "r+") as file:
        del file[layout.EVENTS.path]
        events = file.create_dataset(layout.EVENTS.path, (n,), h5py.string_dtype())
        events[:] = np.array(["x" * 2**20, *[""] * (n - 1)], object)
        at = events.id.get_offset()
    content = bytearray(path.read_bytes())
    content[at : at + n * size_of_a_reference] = content[at : at + size_of_a_reference] * n
    path.write_bytes(content)
