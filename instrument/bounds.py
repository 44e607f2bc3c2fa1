"""Type and size of what an HDF5 file holds, judged before any memory is taken for it."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from typing import Any

import h5py
import hdf5plugin

from instrument.validation import Problem

# Importing hdf5plugin registers its filters. These lose nothing.
FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32", 32000: "lzf", 32001: "blosc"} | {
    int(number): name for name, number in hdf5plugin.FILTERS.items() if name in {"bshuf", "lz4", "zstd", "blosc2"}
}

# A chunk is unpacked as a whole; one frame of 500 megapixels takes so much.
LARGEST_CHUNK_BYTES = 2**30

# No filter but Zstandard packs better than gzip's 1032 to 1, and pictures come nowhere near.
LARGEST_EXPANSION = 1100
SMALL_BYTES = 2**24

# A journal of a line for each of 100 000 poses comes to a fifth of it.
LARGEST_TEXTS_BYTES = 2**27

# The longest text that an attribute of ours has is a page of JSON.
LONGEST_ATTRIBUTE_BYTES = 2**16


def storage_problems(dataset: h5py.Dataset, where: str) -> Iterator[Problem]:
    """Yield what is wrong with how values are stored: packed by an unknown filter, or in chunks that fill memory."""
    created = dataset.id.get_create_plist()
    numbers = [created.get_filter(i)[0] for i in range(created.get_nfilters())]
    unknown = [str(number) for number in numbers if number not in FILTERS]
    if unknown:
        what = f"is packed by HDF5 filter {', '.join(unknown)}; allowed are {', '.join(FILTERS.values())}, or none"
        yield Problem(where, f"{what}. Repack it")
    if dataset.chunks is not None and math.prod(dataset.chunks) * dataset.dtype.itemsize > LARGEST_CHUNK_BYTES:
        yield Problem(where, f"has chunks {dataset.chunks}, of more than {LARGEST_CHUNK_BYTES // 2**20} MiB each")


def size_problems(dataset: h5py.Dataset, where: str) -> Iterator[Problem]:
    """Yield whether a dataset that is read as a whole claims far more than its file can hold."""
    claimed, stored = n_bytes(dataset), file_bytes(dataset.file)
    if claimed > max(SMALL_BYTES, LARGEST_EXPANSION * stored):
        yield Problem(where, f"claims {claimed} bytes of values in a file of {stored}: damaged, or never filled")


def n_bytes(dataset: h5py.Dataset) -> int:
    """Return how much memory all values of a dataset take."""
    return math.prod(dataset.shape or ()) * int(dataset.dtype.itemsize)


def file_bytes(file: h5py.File) -> int:
    """Return how large the file is."""
    return int(file.id.get_filesize())


def text_attribute(thing: h5py.HLObject, name: str) -> str | None:
    """Return an attribute that is one text; None if it is missing, something else or far too long."""
    if name not in thing.attrs:
        return None
    attribute = thing.attrs.get_id(name)
    is_text = h5py.check_string_dtype(attribute.dtype) is not None and attribute.shape == ()
    if not is_text or attribute.get_storage_size() > LONGEST_ATTRIBUTE_BYTES:
        return None
    value = thing.attrs[name]
    return value.decode(errors="replace") if isinstance(value, bytes) else str(value)


def number_problems(dataset: Any, where: str, shape: Iterable[int | str], dims: dict[str, int]) -> Iterator[Problem]:
    """Yield why a dataset is no array of plain numbers of some shape that can be read as a whole.

    Parameters
    ----------
    dataset : object
        What the file holds at the path `where`.
    where : str
    shape : iterable of int or str
        A letter stands for any size, the same wherever it is used.
    dims : dict
        Sizes of the letters so far; new ones are added.
    """
    yield from array_problems(dataset, where)
    wanted = tuple(shape)
    if isinstance(dataset, h5py.Dataset) and not shape_fits(dataset.shape, wanted, dims):
        known = ", ".join(f"{part}={dims[part]}" if part in dims else str(part) for part in map(str, wanted))
        yield Problem(where, f"has shape {dataset.shape}; must be ({known})")


def array_problems(dataset: Any, where: str) -> Iterator[Problem]:
    """Yield why a dataset holds no plain numbers that can be read as a whole; a single one may be an array."""
    if not isinstance(dataset, h5py.Dataset):
        yield Problem(where, "is missing" if dataset is None else "is no dataset")
        return
    if dataset.dtype.kind not in "fiu" or dataset.shape is None:
        yield Problem(where, f"has type {dataset.dtype}; must be numbers")
    yield from storage_problems(dataset, where)
    yield from size_problems(dataset, where)


def shape_fits(shape: tuple[int, ...] | None, wanted: tuple[int | str, ...], dims: dict[str, int]) -> bool:
    """Whether `shape` is as `wanted`: a letter stands for the same size wherever it is used, ``*`` for any."""
    if shape is None or len(shape) != len(wanted):
        return False
    return all(
        part == "*" or size == (dims.setdefault(part, size) if isinstance(part, str) else part)
        for part, size in zip(wanted, shape, strict=True)
    )


def text_problems(dataset: Any, where: str) -> Iterator[Problem]:
    """Yield why a dataset is no text, or row of texts, that can be read as a whole."""
    if not isinstance(dataset, h5py.Dataset):
        yield Problem(where, "is missing" if dataset is None else "is no dataset")
        return
    if h5py.check_string_dtype(dataset.dtype) is None or dataset.shape is None:
        yield Problem(where, f"has type {dataset.dtype}; must be text")
    yield from storage_problems(dataset, where)
    yield from size_problems(dataset, where)
