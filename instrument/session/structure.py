"""Checks that a file has the structure of a session; reads nothing large."""

from __future__ import annotations

from collections.abc import Iterable, Iterator

import h5py
import numpy as np

from instrument.files.untrusted import (
    HDF5_ERRORS,
    hard_linked,
    leading_out,
    shape_fits,
    size_problems,
    storage_problems,
    text_attribute,
)
from instrument.files.validation import Problem
from instrument.session import layout
from instrument.session.layout import Field

# A frame is counts, or floating-point numbers where a picture came as such.
FRAME_DTYPES = ("u2", "f4")

# Letters whose sizes only bound each other: lines of the journal, channels of a curve, a preview's pixels.
MAX_SIZES = {**layout.MAX_SIZES, "K": 3, "h": layout.MAX_SIZES["H"], "w": layout.MAX_SIZES["W"]}

MISSING = "is missing"

Dims = dict[str, int]


def structure_problems(file: h5py.File) -> Iterator[Problem]:
    """Yield everything that is missing, mis-shaped, or points out of the file."""
    try:
        yield from leading_out(file)
        dims: dict[str, int] = {}
        yield from _problems(file, _expected_fields(file), dims)
        yield from _too_large(dims)
    except HDF5_ERRORS as error:
        yield Problem(layout.ENTRY, f"the file is damaged: {error}")


def axis_names(file: h5py.File) -> list[str]:
    """Return the names of the stage's axes."""
    return _groups_within(file, layout.STAGE)


def n_boards(file: h5py.File) -> int:
    """Return how many marker boards the file describes."""
    return len(_groups_within(file, layout.BOARDS))


def _groups_within(file: h5py.File, path: str) -> list[str]:
    group = hard_linked(file, path)
    if not isinstance(group, h5py.Group):
        return []
    return [name for name in group if isinstance(hard_linked(group, name), h5py.Group)]


def _expected_fields(file: h5py.File) -> Iterator[Field]:
    # The frames come first: all other shapes must agree with theirs.
    yield layout.IMAGES
    for field in layout.FIELDS:
        if field is not layout.IMAGES:
            yield field
    for name in axis_names(file):
        yield from (layout.axis_field(name, field.path) for field in layout.AXIS_FIELDS)
    for index in range(n_boards(file)):
        yield from layout.board_fields(index)


def _problems(file: h5py.File, fields: Iterable[Field], dims: Dims) -> Iterator[Problem]:
    known: dict[str, str] = {"": ""}
    for field in fields:
        why = _why_missing(file, field.path, known)
        if why.endswith(MISSING) and field.optional:
            continue
        if why:
            yield Problem(field.path, why.removeprefix(f"{field.path} "))
        else:
            yield from _dataset_problems(file[field.path], field, dims)


def _why_missing(file: h5py.File, path: str, known: dict[str, str]) -> str:
    """Go down link by link: `in` and `get` would follow one into another file; keeps answers in `known`."""
    if path not in known:
        parent = path.rpartition("/")[0]
        known[path] = _why_missing(file, parent, known) or _why_not_in(file, parent, path)
    return known[path]


def _why_not_in(file: h5py.File, parent: str, path: str) -> str:
    if parent and not isinstance(file[parent], h5py.Group):
        return f"{parent} is no group"
    link = file.get(path, getlink=True)
    if link is None:
        return f"{path} {MISSING}"
    if not isinstance(link, h5py.HardLink):
        return f"{path} is a link to elsewhere; a session holds all of its data itself"
    return ""


def _dataset_problems(dataset: h5py.Dataset | h5py.Group, field: Field, dims: Dims) -> Iterator[Problem]:
    if not isinstance(dataset, h5py.Dataset):
        yield Problem(field.path, "is a group and should be a dataset")
        return
    if not _dtype_fits(dataset.dtype, field):
        expected = " or ".join(FRAME_DTYPES) if field.dtype == "frame" else field.dtype
        yield Problem(field.path, f"has type {dataset.dtype}; expected {expected}")
    if not _shape_fits(dataset.shape, field, dims):
        yield Problem(field.path, f"has shape {dataset.shape}; expected {_expected_shape(field, dims)}")
    units = text_attribute(dataset, "units")
    if field.units and units != field.units:
        yield Problem(field.path, f"has units {units!r}; expected {field.units!r}")
    yield from storage_problems(dataset, field.path)
    if "H" not in field.shape:
        # Frames wait for the capture to fill them, and are read one by one.
        yield from size_problems(dataset, field.path)


def _dtype_fits(dtype: np.dtype[np.generic], field: Field) -> bool:
    if field.dtype == "str" or field.dtype.startswith("S"):
        return h5py.check_string_dtype(dtype) is not None
    if field.dtype == "frame":
        return dtype in map(np.dtype, FRAME_DTYPES)
    return dtype == np.dtype(field.dtype)


def _shape_fits(shape: tuple[int, ...] | None, field: Field, dims: Dims) -> bool:
    if shape is None:
        return False
    if field.shape[-1:] == ("C?",) and len(shape) == len(field.shape) - 1:
        # Frames without channels, which then no other field of the session may have.
        shape = (*shape, 0)
    return shape_fits(shape, field.shape, dims)


def _expected_shape(field: Field, dims: Dims) -> str:
    sizes = (str(part) for part in field.shape)
    return f"({', '.join(f'{size}={dims[size]}' if size in dims else size for size in sizes)})"


def _too_large(dims: Dims) -> Iterator[Problem]:
    for name, largest in MAX_SIZES.items():
        if not 0 < dims.get(name, 1) <= largest:
            yield Problem(layout.IMAGES.path, f"has {name} = {dims[name]}; allowed is 1 to {largest}")
    if dims.get("C?", 0) not in (0, 3):
        yield Problem(layout.IMAGES.path, f"has {dims['C?']} channels; allowed are 3, or no such axis")
    bracket = 2 * max(1, dims.get("C?", 0)) * dims.get("E", 0) * dims.get("H", 0) * dims.get("W", 0)
    if bracket > layout.MAX_BRACKET_BYTES:
        limit = layout.MAX_BRACKET_BYTES
        yield Problem(layout.IMAGES.path, f"needs {bracket} bytes for one pose; allowed are {limit}")
