"""Copies a session into a smaller file of the same content."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import h5py
import hdf5plugin
import numpy as np

from instrument.files.new_hdf5 import BOOKKEEPING_BYTES, new_hdf5
from instrument.files.untrusted import objects
from instrument.files.validation import InvalidInputError, Problem, raise_if_any
from instrument.files.whole_file import check_space, written_whole
from instrument.recording.creation import HDF5_FORMAT, refuse_existing
from instrument.session import layout
from instrument.session.layout import Field
from instrument.session.reader import open_session_file
from instrument.session_tools.examination import examination
from instrument.session_tools.summary import is_written

Watcher = Callable[[int, int, str], None]

# Packs frames of 12 bits as well as any level above it does.
ZSTD_LEVEL = 9

# Pictures, one a chunk: they are packed anew, everything else is small and copied as it is.
PICTURES = tuple(field for field in layout.FIELDS if {"H", "h"} & set(field.shape) and field is not layout.FLAT)


def pack_session(path: Path, output: Path, watch: Watcher = lambda done, total, name: None) -> None:
    """Copy a session into the new file `output`, which appears there verified or not at all.

    One picture at a time is in memory. An interrupted session can be resumed in the smaller file too.

    Parameters
    ----------
    path, output : Path
    watch : callable, optional
        Told how many of how many pictures have been packed, and which dataset they are of.

    Raises
    ------
    InvalidInputError
        If the session is damaged, being written, or would not be the same afterwards.
    FileExistsError
        If there is a file at `output`.
    OSError
        If the disk cannot hold it.
    """
    refuse_existing(output)
    _refuse_unsound(path)
    check_space(output, path.stat().st_size)
    with written_whole(output) as part, open_session_file(path) as source:
        # The copy takes less, unless it was packed as tightly before.
        room = int(1.1 * path.stat().st_size) + BOOKKEEPING_BYTES
        with new_hdf5(part, room, HDF5_FORMAT) as target:
            _copy(source, target, watch)
        _refuse_difference(source, part, output)


def _refuse_unsound(path: Path) -> None:
    raise_if_any(f"{path} is damaged and not packed", examination(path).problems)
    if is_written(path):
        what = "another process is writing it; wait until it has ended"
        raise InvalidInputError(f"{path} is not packed", [Problem(str(path), what)])


def _refuse_difference(source: h5py.File, part: Path, output: Path) -> None:
    title = f"{output} is not written: the copy is not what it was made of"
    raise_if_any(title, examination(part).problems)
    with open_session_file(part) as target:
        raise_if_any(title, differences(source, target))


def _copy(source: h5py.File, target: h5py.File, watch: Watcher) -> None:
    """Copy group by group; an object of several names is one object again."""
    pictures = {source[field.path].id: field for field in PICTURES if field.path in source}
    step = _Steps(watch, sum(math.prod(_leading(source[field.path], field)) for field in pictures.values()))
    copied: dict[Any, str] = {}
    copy_attributes(source, target)
    for where, found in objects(source):
        if not isinstance(found, h5py.HLObject):
            target[where] = found
        elif found.id in copied:
            target[where] = target[copied[found.id]]
        elif isinstance(found, h5py.Group):
            copy_attributes(found, target.create_group(where))
        elif found.id in pictures:
            _pack_pictures(found, target, pictures[found.id], where, step)
        else:
            source.copy(found, target, where)
        if isinstance(found, h5py.HLObject):
            copied.setdefault(found.id, where)


class _Steps:
    """Counts pictures for who watches."""

    def __init__(self, watch: Watcher, total: int) -> None:
        self._watch, self._total, self._done = watch, total, 0

    def __call__(self, name: str) -> None:
        self._done += 1
        self._watch(self._done, self._total, name)


def _leading(dataset: h5py.Dataset, field: Field) -> tuple[int, ...]:
    """Return the sizes of the axes before those of a picture."""
    return tuple(dataset.shape[: next(i for i, part in enumerate(field.shape) if part in ("H", "h"))])


def _pack_pictures(
    found: h5py.Dataset, target: h5py.File, field: Field, where: str, step: Callable[[str], None]
) -> None:
    leading = _leading(found, field)
    copy = target.create_dataset(
        where,
        found.shape,
        found.dtype,
        chunks=(1,) * len(leading) + found.shape[len(leading) :],
        fillvalue=found.fillvalue,
        **hdf5plugin.Bitshuffle(cname="zstd", clevel=ZSTD_LEVEL),
    )
    copy_attributes(found, copy)
    for index in np.ndindex(leading):
        picture = found[index]
        # A picture that was never taken needs no place.
        if not np.array_equal(picture, np.full_like(picture, found.fillvalue), equal_nan=picture.dtype.kind == "f"):
            copy[index] = picture
        step(field.name)


def copy_attributes(source: h5py.HLObject, target: h5py.HLObject) -> None:
    """Copy all attributes with their very types."""
    for name in source.attrs:
        attribute = source.attrs.get_id(name)
        copy = h5py.h5a.create(target.id, name.encode(), attribute.get_type(), attribute.get_space())
        if attribute.shape is not None:
            values = np.empty(attribute.shape, attribute.dtype)
            attribute.read(values)
            copy.write(values)


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
