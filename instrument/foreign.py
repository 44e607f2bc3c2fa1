"""Opens an HDF5 file that anyone may have written; nothing is followed out of it, whichever reader asks."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py

from instrument.validation import InvalidInputError, Problem, raise_if_any

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
MOST_OBJECTS = 100_000

# As many as HDF5 itself follows one after the other.
MOST_SOFT_LINKS = 16


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
        if count == MOST_OBJECTS:
            yield Problem("/", f"holds more than {MOST_OBJECTS} links; no file of halfangle has so many")
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
    for _ in range(MOST_SOFT_LINKS):
        more = {where for where, to in soft.items() if where not in out and out.intersection(_prefixes(to))}
        if not more:
            break
        out |= more
    return out


def _prefixes(path: str) -> list[str]:
    parts = list(filter(None, path.split("/")))
    return ["/" + "/".join(parts[: i + 1]) for i in range(len(parts))]
