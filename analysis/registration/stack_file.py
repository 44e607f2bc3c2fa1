"""Registered stacks in files: written view by view, read whole or left in their file.

The format is public (docs/format.md); other laboratories and renderers write it too, so reading checks
everything and reports all that is wrong at once.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Self

import h5py
import numpy as np
from numpy.typing import NDArray

from analysis.registration.stack import Stack, Truth
from instrument.files.json_text import parse_json
from instrument.files.new_hdf5 import BOOKKEEPING_BYTES, new_hdf5
from instrument.files.untrusted import (
    HDF5_ERRORS,
    array_problems,
    hard_linked,
    open_foreign,
    schema_problems,
    text_attribute,
)
from instrument.files.validation import InvalidInputError, Problem, raise_if_any
from instrument.files.whole_file import refuse_unreadable, written_whole
from instrument.session.reader import open_hdf5

Array = NDArray[np.float64]

SCHEMA = "1.1"

NOTES = ("calibration", "session_digest")
"""Texts that travel with a stack: the calibration's figures (JSON) and the digest of the session."""

IN_MEMORY_BYTES = 2**29
"""Radiances beyond this size stay in their file and are read where they are needed, unless they are compressed."""

MAX_BYTES = 48 * 2**30
"""Largest radiance that is read: a size beyond it is a damaged or hostile file, not a capture."""

# Lengths, angles and shares of the geometry, with the attribute of `Stack` that has the same name.
_LENGTHS = (
    "camera_position", "light_position", "pixel_pitch", "light_offset", "light_offset_sigma", "registration_sigma",
)  # fmt: skip

_OTHERS = ("light_power", "camera_rotation", "light_power_sigma", "falloff_sigma")


class StackWriter:
    """Writes a stack view by view; the file appears under its name whole or not at all.

    Parameters
    ----------
    path : Path
        There must be no such file.
    stack : Stack
        All but the pictures, of which only shape and presence count.

    Raises
    ------
    FileExistsError
        If there is a file already.
    InvalidInputError
        At the end, if the stack could not be read again.
    NotWrittenError
        If the disk or the folder does not take it.
    """

    def __init__(self, path: Path, stack: Stack) -> None:
        with ExitStack() as opened:
            file = opened.enter_context(_new_file(path, _most_bytes(stack)))
            file.attrs.update({"NX_class": "NXroot", "default": "entry", "creator": "halfangle"})
            entry = _group(file, "entry", "NXentry", default="stack", halfangle_schema=SCHEMA)
            for name, text in stack.notes.items():
                entry.attrs[name] = text
            self._data = _group(entry, "stack", "NXdata", signal="radiance", pixels=stack.pixels)
            self._create_pictures(stack)
            _write_geometry(_group(entry, "geometry", "NXcollection"), stack)
            if stack.truth is not None:
                _write_truth(_group(entry, "truth", "NXcollection"), stack.truth)
            self._opened = opened.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._opened.__exit__(kind, error, trace)

    def write_view(
        self,
        view: int,
        radiance: NDArray[np.float32],
        variance: NDArray[np.float32] | None = None,
        saturated: NDArray[np.uint8] | None = None,
    ) -> None:
        """Write one view's pictures, each of shape (H, W, C)."""
        for name, values in (("radiance", radiance), ("variance", variance), ("saturated", saturated)):
            if values is not None:
                self._data[name][view] = values

    def _create_pictures(self, stack: Stack) -> None:
        self._data.attrs["axes"] = np.array(["view", ".", ".", "."], dtype=h5py.string_dtype())
        self._data.create_dataset("view", data=np.arange(stack.n_views))
        shape = stack.radiance.shape
        kinds = {"radiance": "f4"}
        kinds |= {"variance": "f4"} if stack.variance is not None else {}
        kinds |= {"saturated": "u1"} if stack.saturated is not None else {}
        for name, dtype in kinds.items():
            self._data.create_dataset(name, shape, dtype, chunks=(1, *shape[1:]))
        interpretation = "rgba-image" if shape[-1] == 3 else "image"
        self._data["radiance"].attrs.update({"interpretation": interpretation, "pixels": stack.pixels})


def write_stack(path: Path, stack: Stack) -> None:
    """Write `stack` to a new file at `path`.

    Raises
    ------
    FileExistsError
        If there is a file already.
    InvalidInputError
        If the stack could not be read again.
    NotWrittenError
        If the disk or the folder does not take it.
    """
    with StackWriter(path, stack) as writer:
        for v in range(stack.n_views):
            variance, saturated = (None if a is None else a[v] for a in (stack.variance, stack.saturated))
            writer.write_view(v, stack.radiance[v], variance, saturated)


def write_truth(path: Path, truth: Truth) -> None:
    """Add what is known of a simulated sample to a stack's file: to a copy, which then takes its place.

    Raises
    ------
    InvalidInputError
        If the stack could not be read again.
    NotWrittenError
        If the disk or the folder does not take the copy; the stack is as it was.
    """
    with written_whole(path, overwrite=True) as part:
        with new_hdf5(part, path.stat().st_size + _truth_bytes(truth) + BOOKKEEPING_BYTES) as file:
            with h5py.File(path, "r") as before:
                file.attrs.update(before.attrs)
                before.copy("entry", file)
            _write_truth(_group(file["entry"], "truth", "NXcollection"), truth)
        refuse_unreadable(path, part, _check_file)


@contextmanager
def _new_file(path: Path, n_bytes: int) -> Iterator[Any]:
    with written_whole(path) as part:
        with new_hdf5(part, n_bytes) as file:
            yield file
        refuse_unreadable(path, part, _check_file)


def _most_bytes(stack: Stack) -> int:
    """Return how large the file of a stack becomes, at most."""
    n_values = math.prod(stack.radiance.shape)
    pictures = n_values * (4 + 4 * (stack.variance is not None) + (stack.saturated is not None))
    texts = sum(len(text.encode()) for text in stack.notes.values())
    truth = 0 if stack.truth is None else _truth_bytes(stack.truth)
    # A view has a chunk in each dataset, and a row in the geometry.
    return pictures + texts + truth + 1000 * stack.n_views + BOOKKEEPING_BYTES


def _truth_bytes(truth: Truth) -> int:
    return truth.normals.nbytes + truth.depth.nbytes + (0 if truth.material is None else truth.material.nbytes)


def _group(parent: Any, name: str, nx_class: str, **attributes: str) -> Any:
    group = parent.create_group(name)
    group.attrs.update({"NX_class": nx_class, **attributes})
    return group


def _write_geometry(group: Any, stack: Stack) -> None:
    for name in (*_LENGTHS, *_OTHERS):
        value = getattr(stack, name)
        if value is not None:
            group.create_dataset(name, data=value)
    for name in _LENGTHS:
        if name in group:
            group[name].attrs["units"] = "mm"


def _write_truth(group: Any, truth: Truth) -> None:
    group.create_dataset("normals", data=truth.normals, dtype="f4")
    group.create_dataset("depth", data=truth.depth).attrs["units"] = "mm"
    if truth.material is not None:
        group.create_dataset("material", data=truth.material)


def is_stack(path: Path) -> bool:
    """Tell whether a file claims to be a registered stack (and not, say, a session); a damaged one by its name."""
    try:
        with open_hdf5(path) as file:
            return bool(hard_linked(file, "/entry/stack") or not hard_linked(file, "/entry/instrument"))
    except HDF5_ERRORS:
        return path.name.endswith(".stack.h5")


def read_stack(path: Path) -> Stack:
    """Read a registered stack, whoever wrote it.

    Raises
    ------
    InvalidInputError
        With everything that is missing or of the wrong shape, by its path in the file.
    """
    title = f"{path} cannot be read as a registered stack."
    file = open_foreign(path, title)
    try:
        stack = _read_checked(file, title, IN_MEMORY_BYTES)
    except HDF5_ERRORS as error:
        file.close()
        if isinstance(error, InvalidInputError):
            raise
        raise InvalidInputError(title, [Problem(str(path), f"damaged: {error}")]) from None
    if isinstance(stack.radiance, np.ndarray):
        file.close()
    return stack


def _check_file(path: Path) -> None:
    """Raise what `read_stack` would, one view in memory at a time."""
    with open_foreign(path, "") as file:
        _read_checked(file, "", 0)


def _read_checked(file: Any, title: str, in_memory: int) -> Stack:
    raise_if_any(title, _check(file))
    stack = _read(file, in_memory)
    raise_if_any(title, _check_values(stack))
    return stack


_RADIANCE = "/entry/stack/radiance"

_GEOMETRY = "/entry/geometry"


def _check(file: Any) -> Iterator[Problem]:
    """Structure: what must be there, its shape and kind."""
    yield from schema_problems(file, SCHEMA)
    dataset = _dataset(file, _RADIANCE)
    if dataset is None:
        yield Problem(_RADIANCE, "missing; a stack needs the dataset radiance[view, height, width, channel]")
        return
    shape: tuple[int, ...] = dataset.shape or ()
    if len(shape) != 4 or shape[-1] not in (1, 3) or 0 in shape:
        yield Problem(_RADIANCE, f"has shape {shape}; must be (views, height, width, channels), channels 1 or 3")
        return
    yield from array_problems(dataset, _RADIANCE)
    if np.prod(shape, dtype=np.float64) * 4 > MAX_BYTES:
        yield Problem(_RADIANCE, f"has shape {shape}: more than {MAX_BYTES // 2**30} GiB; cut the area into parts")
    for name in ("variance", "saturated"):
        yield from _check_optional(file, f"/entry/stack/{name}", shape)
    n = shape[0]
    needed: dict[str, tuple[int, ...]] = {"camera_position": (n, 3), "light_position": (n, 3), "pixel_pitch": ()}
    for name, wanted in needed.items():
        found = _dataset(file, f"{_GEOMETRY}/{name}")
        if found is None:
            what = "is no dataset" if f"{_GEOMETRY}/{name}" in file else "missing"
            yield Problem(f"{_GEOMETRY}/{name}", f"{what}; must have shape {wanted}, in mm")
            continue
        yield from array_problems(found, f"{_GEOMETRY}/{name}")
        if found.shape != wanted and not (wanted == () and found.size == 1):
            advice = "; pixels must be square: resample the stack to one pitch" if name == "pixel_pitch" else ""
            yield Problem(f"{_GEOMETRY}/{name}", f"has shape {found.shape}; must be {wanted}{advice}")
    optional: dict[str, tuple[int, ...]] = {
        f"{_GEOMETRY}/light_power": (n,),
        f"{_GEOMETRY}/camera_rotation": (n, 3, 3),
        f"{_GEOMETRY}/light_offset": (3,),
        f"{_GEOMETRY}/light_offset_sigma": (3,),
        f"{_GEOMETRY}/light_power_sigma": (n,),
        f"{_GEOMETRY}/registration_sigma": (n,),
        f"{_GEOMETRY}/falloff_sigma": (),
        "/entry/truth/normals": (*shape[1:3], 3),
        "/entry/truth/depth": shape[1:3],
        "/entry/truth/material": shape[1:3],
    }
    for path, wanted in optional.items():
        yield from _check_optional(file, path, wanted)


def _dataset(file: Any, path: str) -> Any:
    """Return the dataset at `path`, or None."""
    found = file.get(path)
    return found if isinstance(found, h5py.Dataset) else None


def _check_optional(file: Any, path: str, wanted: tuple[int, ...]) -> Iterator[Problem]:
    found = _dataset(file, path)
    if found is None and path in file:
        yield Problem(path, "is no dataset")
    if found is None:
        return
    yield from array_problems(found, path)
    if found.shape != wanted:
        yield Problem(path, f"has shape {found.shape}; must be {wanted}")


def _read(file: Any, in_memory: int) -> Stack:
    def optional(path: str, dtype: type[Any]) -> Any:
        found = _dataset(file, path)
        # A number beyond float32 becomes infinite, which is not seen.
        with np.errstate(over="ignore"):
            return None if found is None else np.asarray(found[...], dtype)

    radiance = _dataset(file, _RADIANCE)
    n = radiance.shape[0]
    pictures = {"radiance": np.float32, "variance": np.float32, "saturated": np.uint8}
    found = {name: _dataset(file, f"/entry/stack/{name}") for name in pictures}
    if not _stays_on_disk([dataset for dataset in found.values() if dataset is not None], in_memory):
        found = {name: optional(f"/entry/stack/{name}", dtype) for name, dtype in pictures.items()}
    light_power = optional(f"{_GEOMETRY}/light_power", np.float64)
    falloff_sigma = optional(f"{_GEOMETRY}/falloff_sigma", np.float64)
    normals, depth = optional("/entry/truth/normals", np.float64), optional("/entry/truth/depth", np.float64)
    stated = (text_attribute(thing, "pixels") for thing in (radiance, file["/entry/stack"]))
    return Stack(
        radiance=found["radiance"],
        camera_position=optional(f"{_GEOMETRY}/camera_position", np.float64),
        light_position=optional(f"{_GEOMETRY}/light_position", np.float64),
        pixel_pitch=float(np.ravel(_dataset(file, f"{_GEOMETRY}/pixel_pitch")[...])[0]),
        light_power=np.ones(n) if light_power is None else light_power,
        variance=found["variance"],
        saturated=found["saturated"],
        pixels=next((text for text in stated if text is not None), "surface"),
        camera_rotation=optional(f"{_GEOMETRY}/camera_rotation", np.float64),
        light_offset=optional(f"{_GEOMETRY}/light_offset", np.float64),
        light_offset_sigma=optional(f"{_GEOMETRY}/light_offset_sigma", np.float64),
        light_power_sigma=optional(f"{_GEOMETRY}/light_power_sigma", np.float64),
        registration_sigma=optional(f"{_GEOMETRY}/registration_sigma", np.float64),
        falloff_sigma=None if falloff_sigma is None else float(falloff_sigma),
        notes={name: text for name in NOTES if (text := text_attribute(file["/entry"], name)) is not None},
        truth=_truth(normals, depth, optional("/entry/truth/material", np.int64)),
    )


def _stays_on_disk(datasets: list[Any], in_memory: int) -> bool:
    """Tell whether pictures are large, and lie in their file so that a part can be read without the rest."""
    # A compressed chunk must be unpacked as a whole, again for every tile, and one of many views for every view.
    plain = all(
        d.id.get_create_plist().get_nfilters() == 0 and (d.chunks is None or d.chunks[0] == 1) for d in datasets
    )
    return plain and sum(np.prod(d.shape, dtype=np.float64) * d.dtype.itemsize for d in datasets) > in_memory


def _truth(normals: Array | None, depth: Array | None, material: NDArray[np.int64] | None) -> Truth | None:
    if normals is None:
        return None
    return Truth(normals, np.full(normals.shape[:2], np.nan) if depth is None else depth, material)


def _check_values(stack: Stack) -> Iterator[Problem]:
    """Values: finite geometry in front of the sample, something to see."""
    for name in ("camera_position", "light_position"):
        position = getattr(stack, name)
        if not np.all(np.isfinite(position)):
            bad = np.flatnonzero(~np.isfinite(position).all(axis=1))
            yield Problem(f"{_GEOMETRY}/{name}", f"not finite in views {bad.tolist()}")
        elif np.any(position[:, 2] <= 0.0):
            bad = np.flatnonzero(position[:, 2] <= 0.0)
            yield Problem(
                f"{_GEOMETRY}/{name}",
                f"views {bad.tolist()} lie behind the sample (z <= 0); z must be mm above it",
            )
    if not (np.isfinite(stack.pixel_pitch) and stack.pixel_pitch > 0.0):
        yield Problem(f"{_GEOMETRY}/pixel_pitch", f"is {stack.pixel_pitch}; must be a positive number of mm")
    if not np.all(np.isfinite(stack.light_power) & (stack.light_power > 0.0)):
        yield Problem(f"{_GEOMETRY}/light_power", "must be positive and finite for every view")
    for name in ("camera_rotation", "light_offset", "light_offset_sigma", "light_power_sigma", "registration_sigma"):
        values = getattr(stack, name)
        if values is not None and not np.isfinite(values).all():
            yield Problem(f"{_GEOMETRY}/{name}", "must be finite; leave it out if it is not known")
    yield from _note_problems(stack)
    if stack.pixels not in ("surface", "independent"):
        yield Problem(_RADIANCE, f"attribute pixels is {stack.pixels!r}; must be 'surface' or 'independent'")
    # All views, though one would do: what cannot be read is to be said now and not in the middle of the work.
    seen = [bool(np.isfinite(stack.radiance[v]).any()) for v in range(stack.n_views)]
    if not any(seen):
        yield Problem(_RADIANCE, "has no finite value: no view sees the sample")


def _note_problems(stack: Stack) -> Iterator[Problem]:
    try:
        figures = parse_json(stack.notes.get("calibration") or "{}")
    except ValueError as error:
        yield Problem("/entry@calibration", f"is not JSON ({error}); leave the attribute out")
        return
    if not isinstance(figures, dict):
        yield Problem("/entry@calibration", "must be figures by name; leave the attribute out")
