"""Reads all parts of a file that have crashed readers before: texts in the HDF5 heap, and packed values."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from instrument.files.child import ReaderEndedError, in_child
from instrument.files.untrusted import HDF5_ERRORS, MAX_TEXTS_BYTES, objects, storage_problems
from instrument.files.validation import InvalidInputError, Problem

WHOLE, UNPACKED = "whole", "unpacked"
"""Look at everything; or leave out what is packed, as pictures are, for who does not read them."""

MEMORY = "needs more memory than any file of halfangle"


def refuse_dangerous(path: Path, extent: str = WHOLE) -> None:
    """Look at a file in a child process, before this process reads it.

    Costs the start of a process (0.2 s), and the time to read all that is packed once if `extent` is `WHOLE`.

    Parameters
    ----------
    path : Path
        It need not be there or be HDF5: its reader says so.
    extent : {"whole", "unpacked"}

    Raises
    ------
    InvalidInputError
        If reading it ends the child, does not come to an end, or fills the memory; with where.
    """
    if not path.is_file():
        return
    where = str(path)
    try:
        for step in in_child("look", path, extent):
            where = step.get("at", where)
            if "problem" in step:
                raise InvalidInputError(f"{path} is not read", [Problem(where, step["problem"])])
    except ReaderEndedError as error:
        raise InvalidInputError(f"{path} is not read", [ended_problem(where, error)]) from None


def ended_problem(where: str, error: ReaderEndedError) -> Problem:
    """Return what is to be said of a file whose reading ended a child process at `where`."""
    return Problem(where, f"the file is damaged: a process that was reading this {error}")


def look(path: str, extent: str = WHOLE) -> Iterator[dict[str, Any]]:
    """Touch what is in the file and yield each path before it is touched; runs in the child.

    What merely fails is no matter here: a reader says it better.
    """
    yield {"at": path}
    with suppress(*HDF5_ERRORS), h5py.File(path, "r", locking=False) as file:
        yield {"at": "/"}
        yield from _guarded(file, extent)
        touched = set()
        for where, found in objects(file):
            # A dataset may be there under several names.
            if not isinstance(found, h5py.HLObject) or found.id in touched:
                continue
            touched.add(found.id)
            yield {"at": where}
            yield from _guarded(found, extent)


def _guarded(thing: Any, extent: str) -> Iterator[dict[str, Any]]:
    try:
        if isinstance(thing, h5py.Dataset | h5py.Group):
            for name in thing.attrs:
                _touch_attribute(thing, name)
        if isinstance(thing, h5py.Dataset):
            yield from _touch_values(thing, extent)
    except MemoryError:
        yield {"problem": MEMORY}
    except HDF5_ERRORS:
        return


def _touch_attribute(thing: h5py.HLObject, name: str) -> None:
    with suppress(*(kind for kind in HDF5_ERRORS if kind is not MemoryError)):
        thing.attrs[name]


def _touch_values(dataset: h5py.Dataset, extent: str) -> Iterator[dict[str, Any]]:
    if dataset.is_virtual or dataset.external or any(storage_problems(dataset, "")):
        return
    if h5py.check_string_dtype(dataset.dtype) is not None and dataset.dtype.kind == "O":
        yield from _touch_texts(dataset)
    elif extent == WHOLE and dataset.chunks is not None and dataset.dtype.kind in "fiuS":
        yield from _touch_chunks(dataset)


def _touch_texts(dataset: h5py.Dataset) -> Iterator[dict[str, Any]]:
    """Read texts one by one: many may be one and the same in the file, and fill the memory all the same."""
    total = 0
    for index in np.ndindex(dataset.shape):
        total += len(dataset[index])
        if total > MAX_TEXTS_BYTES:
            yield {"problem": MEMORY}
            return


def _touch_chunks(dataset: h5py.Dataset) -> Iterator[dict[str, Any]]:
    offsets: list[tuple[int, ...]] = []
    dataset.id.chunk_iter(lambda chunk: offsets.append(chunk.chunk_offset))
    if dataset.id.get_create_plist().get_nfilters() == 0:
        # What is not packed is only copied, which ends nobody.
        return
    for offset in offsets:
        yield {"at": f"{dataset.name}[{', '.join(map(str, offset))}]"}
        with suppress(*(kind for kind in HDF5_ERRORS if kind is not MemoryError)):
            dataset[tuple(slice(o, o + n) for o, n in zip(offset, dataset.chunks, strict=True))]
