"""Creates the whole tree of a session file, so that the capture only fills what is there."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from importlib.metadata import version
from typing import Any

import h5py
import hdf5plugin
import numpy as np

from drivers.stage import AxisDescription
from instrument.recording.header import SessionHeader, known_values
from instrument.session import layout
from instrument.session.layout import Field
from instrument.session.preview import preview_shape


def write_tree(file: h5py.File, header: SessionHeader) -> None:
    """Write all groups, attributes and empty datasets, and all that is known before the first pose."""
    now = datetime.now(UTC).isoformat()
    _write_root(file, now)
    for path, nx_class in layout.GROUPS.items():
        file.require_group(path).attrs["NX_class"] = nx_class
    _write_fields(file, header, known_values(header, now))
    _write_axes(file, header)
    _write_boards(file, header)
    _write_plots(file)


def _write_root(file: h5py.File, now: str) -> None:
    file.attrs.update(
        NX_class="NXroot",
        default="entry",
        creator="halfangle",
        creator_version=version("halfangle"),
        file_time=now,
        HDF5_Version=h5py.version.hdf5_version,
        h5py_version=h5py.version.version,
    )


def _write_fields(file: h5py.File, header: SessionHeader, known: Mapping[Field, Any]) -> None:
    dims = _dims(header)
    later = {layout.DARK, layout.DARK_VARIANCE, layout.DARK_TIMESTAMP} if header.has_darks else set()
    for field in layout.FIELDS:
        if not field.optional or field in later or field in known:
            _create(file, field, header, _shape(field, dims), known.get(field))
    for field, shape in header.empty.items():
        _create(file, field, header, shape, None)
    for note, kind in layout.NOTES.items():
        if note.path in file:
            _describe_note(file[note.group], kind)


def _describe_note(group: h5py.Group, kind: str) -> None:
    group.attrs["NX_class"] = "NXnote"
    group["type"] = kind
    if kind == "application/toml":
        group["file_name"] = f"{group.name.rpartition('/')[2]}.toml"


def _create(file: h5py.File, field: Field, header: SessionHeader, shape: tuple[int, ...], value: Any) -> h5py.Dataset:
    dtype = h5py.string_dtype() if field.dtype == "str" else np.dtype(_dtype(field, header))
    # A value that is known brings its own shape: not all letters have a size in every session.
    shape = shape if value is None or isinstance(value, str) else np.shape(value)
    options: dict[str, Any] = {}
    if field.dtype == "frame":
        # Lossless, half the size at 2 ms more a frame; one frame a chunk, so that none needs its neighbours.
        n_leading = field.shape.index("H")
        options = {"chunks": (1,) * n_leading + shape[n_leading:], **hdf5plugin.Bitshuffle(cname="lz4")}
    elif field is layout.EVENTS:
        options = {"maxshape": (None,), "chunks": (64,)}
    else:
        # From the start, so that a disk that fills up later does so at a frame, where room is made sure of first.
        options["dcpl"] = _allocated_early()
    if dtype.kind == "f":
        options["fillvalue"] = np.nan
    dataset = file.create_dataset(field.path, shape, dtype, data=value, **options)
    if field.units:
        dataset.attrs["units"] = field.units
    return dataset


def _allocated_early() -> h5py.h5p.PropDCID:
    properties = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    properties.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
    return properties


def _dtype(field: Field, header: SessionHeader) -> str:
    return header.camera.dtype if field.dtype == "frame" else field.dtype


def _shape(field: Field, dims: Mapping[str | int, int | None]) -> tuple[int, ...]:
    """Return the sizes of a field; an axis that frames of this camera lack has none."""
    sizes = (dims.get(part, part) for part in field.shape)
    return tuple(size for size in sizes if isinstance(size, int))


def _dims(header: SessionHeader) -> dict[str | int, int | None]:
    camera = header.camera
    h, w = preview_shape(camera.height, camera.width)
    channels = camera.n_channels if camera.n_channels > 1 else None
    n_poses, n_exposures = header.n_poses, len(header.exposure_times)
    frame: dict[str | int, int | None] = {"H": camera.height, "W": camera.width, "C?": channels}
    return {"P": n_poses, "E": n_exposures, **frame, "h": h, "w": w, "*": 0}


def _write_axes(file: h5py.File, header: SessionHeader) -> None:
    """Write an NXpositioner for each axis and chain their values as transformations of the sample."""
    rides_on = "."
    for axis in header.axes:
        file.require_group(f"{layout.STAGE}/{axis.name}").attrs["NX_class"] = "NXpositioner"
        for field, value in _axis_values(axis, header):
            _create(file, field, header, _shape(field, _dims(header)), value)
        position = file[layout.axis_field(axis.name, "value").path]
        position.attrs.update(transformation_type=axis.kind, vector=axis.vector, depends_on=rides_on)
        rides_on = f"{layout.TRANSFORMATIONS}/{axis.name}"
        file[rides_on] = position
    file[layout.SAMPLE]["depends_on"] = rides_on


def _axis_values(axis: AxisDescription, header: SessionHeader) -> Iterator[tuple[Field, Any]]:
    units = "deg" if axis.kind == "rotation" else "mm"
    values = {
        "target_value": header.targets.get(axis.name),
        "tolerance": axis.tolerance,
        "soft_limit_min": axis.soft_limits.low,
        "soft_limit_max": axis.soft_limits.high,
    }
    for field in layout.AXIS_FIELDS:
        yield layout.axis_field(axis.name, field.path, units), values.get(field.path)


def _write_boards(file: h5py.File, header: SessionHeader) -> None:
    for index, board in enumerate(header.boards):
        file.require_group(layout.board_group(index)).attrs["NX_class"] = "NXcollection"
        for field in layout.board_fields(index):
            _create(file, field, header, _shape(field, {}), getattr(board, field.name))


def _write_plots(file: h5py.File) -> None:
    """Write what the viewers of NeXus look for; the attributes are exactly the types they insist on."""
    file[layout.ENTRY].attrs.update({"default": "overview", layout.SCHEMA_ATTRIBUTE: layout.SCHEMA_VERSION})
    for group, fields in layout.LINKS.items():
        for field in fields:
            file[group]["pose" if field is layout.ORDER else field.name] = file[field.path]
    n_axes = file[layout.IMAGES.path].ndim
    file[layout.IMAGES.path].attrs["interpretation"] = "image" if n_axes == 4 else "rgba-image"
    file[layout.PREVIEW.path].attrs["interpretation"] = "image"
    _plot(file[layout.OVERVIEW], "preview", ["pose", ".", "."])
    _plot(file[layout.RAW], "images", ["pose", "count_time", *["."] * (n_axes - 2)])
    _plot(file[layout.QUALITY], "saturated_fraction", ["pose", "count_time"])
    file[layout.OVERVIEW].attrs["SILX_style"] = json.dumps({"signal_scale_type": "log"})
    file[layout.QUALITY].attrs["auxiliary_signals"] = ["black_fraction"]
    if layout.REFERENCE.path in file:
        _write_drift_curve(file[layout.REFERENCE_GROUP], file[layout.ORDER.path])
    if layout.LIGHT_OFFSET.path in file:
        file[layout.LIGHT]["position"] = file[layout.LIGHT_OFFSET.path]


def _write_drift_curve(group: h5py.Group, order: h5py.Dataset) -> None:
    group.attrs["NX_class"] = "NXdata"
    group["pose"] = order
    _plot(group, layout.REFERENCE.name, ["pose"])


def _plot(group: h5py.Group, signal: str, axes: list[str]) -> None:
    group.attrs.update(signal=signal, axes=axes)
