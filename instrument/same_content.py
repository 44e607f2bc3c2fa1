"""Do two HDF5 files hold the same? However they store it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import h5py
import numpy as np

from instrument.foreign import objects
from instrument.validation import Problem


def differences(one: h5py.File, other: h5py.File) -> Iterator[Problem]:
    """Yield each path at which two files differ: names, links, types, attributes or values; a row at a time."""
    ours, theirs = dict(objects(one)), dict(objects(other))
    for where in sorted(ours.keys() ^ theirs.keys()):
        yield Problem(where, "is in one of the two files only")
    yield from (Problem(name, "is another attribute") for name in _different_attributes(one, other))
    for where in ours.keys() & theirs.keys():
        yield from _different_objects(where, ours[where], theirs[where])
    if _names(ours) != _names(theirs):
        yield Problem("/", "has other names for one object")


def _names(found: dict[str, Any]) -> set[frozenset[str]]:
    """Return the sets of names that one object has."""
    names: dict[Any, set[str]] = {}
    for where, thing in found.items():
        if isinstance(thing, h5py.HLObject):
            names.setdefault(thing.id, set()).add(where)
    return {frozenset(same) for same in names.values()}


def _different_objects(where: str, one: Any, other: Any) -> Iterator[Problem]:
    if type(one) is not type(other):
        yield Problem(where, "is of another kind")
    elif isinstance(one, h5py.HLObject):
        yield from (Problem(f"{where}@{name}", "is another attribute") for name in _different_attributes(one, other))
        if isinstance(one, h5py.Dataset) and not _same_values(one, other):
            yield Problem(where, "has another type, shape or other values")
    elif isinstance(one, h5py.SoftLink) and one.path != other.path:
        yield Problem(where, "links elsewhere")


def _different_attributes(one: h5py.HLObject, other: h5py.HLObject) -> Iterator[str]:
    for name in sorted(set(one.attrs) | set(other.attrs)):
        if name not in one.attrs or name not in other.attrs or not _same_attribute(one, other, name):
            yield name


def _same_attribute(one: h5py.HLObject, other: h5py.HLObject, name: str) -> bool:
    same_type = one.attrs.get_id(name).dtype == other.attrs.get_id(name).dtype
    return bool(same_type and _equal(one.attrs[name], other.attrs[name]))


def _same_values(one: h5py.Dataset, other: h5py.Dataset) -> bool:
    if one.dtype != other.dtype or one.shape != other.shape:
        return False
    if len(one.shape or ()) < 3:
        return _equal(one[()], other[()])
    return all(_equal(one[index], other[index]) for index in np.ndindex(one.shape[: 1 if one.ndim == 3 else 2]))


def _equal(one: Any, other: Any) -> bool:
    a, b = np.asarray(one), np.asarray(other)
    # Bit by bit, so that NaN is equal to itself and -0 differs from 0; texts lie elsewhere in memory.
    return a.shape == b.shape and (a.tolist() == b.tolist() if a.dtype == object else a.tobytes() == b.tobytes())
