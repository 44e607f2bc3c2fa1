"""Opens an HDF5 file that anyone may have written; nothing is followed out of it, whichever reader asks."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import h5py
import hdf5plugin

from instrument.files.validation import InvalidInputError, Problem, raise_if_any
from instrument.files.whole_file import NO_LOCKS

# What h5py raises on a damaged file, depending on which byte is wrong.
HDF5_ERRORS = (
    OSError,
    RuntimeError,
    LookupError,
    ValueError,
    TypeError,
    AttributeError,
    ArithmeticError,
    MemoryError,
    SystemError,
)

# Those of a real file are counted in hundreds.
MAX_OBJECTS = 100_000

# As many as HDF5 itself follows one after the other.
MAX_SOFT_LINKS = 16

# Importing hdf5plugin registers its filters. These lose nothing.
FILTERS = {1: "gzip", 2: "shuffle", 3: "fletcher32", 32000: "lzf", 32001: "blosc"} | {
    int(number): name for name, number in hdf5plugin.FILTERS.items() if name in {"bshuf", "lz4", "zstd", "blosc2"}
}

# A chunk is unpacked as a whole; one frame of 500 megapixels takes so much.
MAX_CHUNK_BYTES = 2**30

# No filter but Zstandard packs better than gzip's 1032 to 1, and pictures come nowhere near.
MAX_EXPANSION = 1100

SMALL_BYTES = 2**24

# A journal of a line for each of 100 000 poses comes to a fifth of it.
MAX_TEXTS_BYTES = 2**27

# The longest text that an attribute of ours has is a page of JSON.
MAX_ATTRIBUTE_BYTES = 2**16


def open_foreign(path: Path, title: str) -> h5py.File:
    """Open a file that anyone may have written, to read it.

    Parameters
    ----------
    path : Path
    title : str
        First line of the error.

    Raises
    ------
    InvalidInputError
        If it is missing, not HDF5, damaged, or leads to other files; with all such links and datasets.
    """
    try:
        file = h5py.File(path, "r")
    except (OSError, RuntimeError, ValueError) as error:
        raise InvalidInputError(title, [Problem(str(path), why_not_open(path, error))]) from None
    try:
        raise_if_any(title, leading_out(file))
    except HDF5_ERRORS as error:
        file.close()
        if isinstance(error, InvalidInputError):
            raise
        raise InvalidInputError(title, [Problem(str(path), f"the file is damaged: {error}")]) from None
    return file


def why_not_open(path: Path, error: Exception) -> str:
    """Say why HDF5 did not open `path`."""
    if not path.exists():
        return "there is no such file"
    if path.is_dir():
        return "this is a folder; name a file in it"
    if isinstance(error, PermissionError):
        return "there is no permission to read it"
    if isinstance(error, OSError) and error.errno in NO_LOCKS:
        return (
            "its file system has no locks. Set the environment variable HDF5_USE_FILE_LOCKING=FALSE if no other "
            "program writes the file, then try again"
        )
    if not h5py.is_hdf5(path):
        return "this is not an HDF5 file"
    return f"the file is damaged or cut short: {error}"


def objects(file: h5py.File) -> Iterator[tuple[str, Any]]:
    """Walk every group once and yield path and object; of links that are not hard ones the link itself.

    Nothing is followed out of the file.
    """
    seen, waiting = {file.id}, [("", file["/"])]
    while waiting:
        parent, group = waiting.pop()
        for name in group:
            where, found = f"{parent}/{name}", _at(group, name)
            yield where, found
            if isinstance(found, h5py.Group) and found.id not in seen:
                seen.add(found.id)
                waiting.append((where, found))


def _at(group: h5py.Group, name: str) -> Any:
    link = group.get(name, getlink=True)
    return group[name] if isinstance(link, h5py.HardLink) else link


def hard_linked(group: h5py.Group, path: str) -> Any:
    """Return what a path leads to by hard links alone, which stay in their file; None if nothing."""
    found: Any = group
    for name in path.strip("/").split("/"):
        if not isinstance(found, h5py.Group) or not isinstance(found.get(name, getlink=True), h5py.HardLink):
            return None
        found = found[name]
    return found


def leading_out(file: h5py.File) -> Iterator[Problem]:
    """Yield each link and dataset that takes anything from another file."""
    out: set[str] = set()
    soft: dict[str, str] = {}
    for count, (where, found) in enumerate(objects(file)):
        if count == MAX_OBJECTS:
            yield Problem("/", f"holds more than {MAX_OBJECTS} links; no file of halfangle has so many")
            return
        if isinstance(found, h5py.ExternalLink):
            out.add(where)
        elif isinstance(found, h5py.SoftLink):
            soft[where] = found.path if found.path.startswith("/") else f"{where.rpartition('/')[0]}/{found.path}"
        elif isinstance(found, h5py.Dataset) and (found.is_virtual or found.external):
            yield Problem(where, "takes its values from other files; it must hold all of its data itself")
    for where in sorted(_with_soft(out, soft)):
        yield Problem(where, "links to another file; it must hold all of its data itself")


def _with_soft(out: set[str], soft: dict[str, str]) -> set[str]:
    """Add the soft links that come to a link in `out`, directly or by other soft links."""
    for _ in range(MAX_SOFT_LINKS):
        more = {where for where, to in soft.items() if where not in out and out.intersection(_prefixes(to))}
        if not more:
            break
        out |= more
    return out


def _prefixes(path: str) -> list[str]:
    parts = list(filter(None, path.split("/")))
    return ["/" + "/".join(parts[: i + 1]) for i in range(len(parts))]


def storage_problems(dataset: h5py.Dataset, where: str) -> Iterator[Problem]:
    """Yield what is wrong with how values are stored: packed by an unknown filter, or in chunks that fill memory."""
    created = dataset.id.get_create_plist()
    numbers = [created.get_filter(i)[0] for i in range(created.get_nfilters())]
    unknown = [str(number) for number in numbers if number not in FILTERS]
    if unknown:
        what = f"is packed by HDF5 filter {', '.join(unknown)}; allowed are {', '.join(FILTERS.values())}, or none"
        yield Problem(where, f"{what}. Repack it")
    if dataset.chunks is not None and math.prod(dataset.chunks) * dataset.dtype.itemsize > MAX_CHUNK_BYTES:
        yield Problem(where, f"has chunks {dataset.chunks}, of more than {MAX_CHUNK_BYTES // 2**20} MiB each")


def size_problems(dataset: h5py.Dataset, where: str) -> Iterator[Problem]:
    """Yield whether a dataset that is read as a whole claims far more than its file can hold."""
    claimed, stored = n_bytes(dataset), file_bytes(dataset.file)
    if claimed > max(SMALL_BYTES, MAX_EXPANSION * stored):
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
    if not is_text or attribute.get_storage_size() > MAX_ATTRIBUTE_BYTES:
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


def schema_problems(file: h5py.File, schema: str) -> Iterator[Problem]:
    """Yield that a file has another major version than `schema`; one that states none is taken as it is."""
    entry = hard_linked(file, "/entry")
    found = text_attribute(entry, "halfangle_schema") if isinstance(entry, h5py.Group) else None
    major = schema.split(".", maxsplit=1)[0]
    if found is not None and found.split(".", maxsplit=1)[0] != major:
        what = f"is {found}; this halfangle reads {major}.x. Read it with the version that wrote it"
        yield Problem("/entry@halfangle_schema", what)
