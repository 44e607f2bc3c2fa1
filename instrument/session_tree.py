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
from instrument import layout
from instrument.layout import Field
from instrument.preview import preview_shape
from instrument.session_header import SessionHeader
from instrument.session_values import known_values


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
    for field in layout.FIELDS:
        if not field.optional or (header.darks and field is not layout.FLAT):
            _create(file, field, dims, known.get(field))
    for note in (layout.RIG_TEXT, layout.PROTOCOL_TEXT):
        file[note.group]["type"] = "application/toml"
        file[note.group]["file_name"] = f"{note.group.rpartition('/')[2]}.toml"
    for note in (layout.RIG_JSON, layout.VERSIONS):
        file[note.group]["type"] = "application/json"


def _create(file: h5py.File, field: Field, dims: Mapping[str | int, int], value: Any) -> h5py.Dataset:
    dtype = h5py.string_dtype() if field.dtype == "str" else np.dtype(field.dtype)
    shape = tuple(dims.get(part, part) for part in field.shape)
    options: dict[str, Any] = {}
    if field is layout.IMAGES:
        # Lossless, half the size at 2 ms more a frame; one frame a chunk, so that none needs its neighbours.
        options = {"chunks": (1, 1, *shape[2:]), **hdf5plugin.Bitshuffle(cname="lz4")}
    elif field is layout.EVENTS:
        options = {"maxshape": (None,), "chunks": (64,)}
    if dtype.kind == "f":
        options["fillvalue"] = np.nan
    dataset = file.create_dataset(field.path, shape, dtype, data=value, **options)
    if field.units:
        dataset.attrs["units"] = field.units
    return dataset


def _dims(header: SessionHeader) -> dict[str | int, int]:
    height, width = header.frame_shape
    h, w = preview_shape(height, width)
    n_exposures = len(header.exposure_times)
    return {"P": header.n_poses, "E": n_exposures, "H": height, "W": width, "h": h, "w": w, "*": 0}


def _write_axes(file: h5py.File, header: SessionHeader) -> None:
    """Write an NXpositioner for each axis and chain their values as transformations of the sample."""
    rides_on = "."
    for axis in header.stage.axes:
        file.require_group(f"{layout.STAGE}/{axis.name}").attrs["NX_class"] = "NXpositioner"
        for field, value in _axis_values(axis, header):
            _create(file, field, _dims(header), value)
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
    for index, board in enumerate(header.rig.boards):
        file.require_group(layout.board_group(index)).attrs["NX_class"] = "NXcollection"
        for field in layout.board_fields(index):
            _create(file, field, {}, getattr(board, field.name))


def _write_plots(file: h5py.File) -> None:
    """Write what the viewers of NeXus look for; the attributes are exactly the types they insist on."""
    file[layout.ENTRY].attrs.update({"default": "overview", layout.SCHEMA_ATTRIBUTE: layout.SCHEMA_VERSION})
    for group, fields in layout.LINKS.items():
        for field in fields:
            file[group]["pose" if field is layout.ORDER else field.name] = file[field.path]
    for field in (layout.IMAGES, layout.PREVIEW):
        file[field.path].attrs["interpretation"] = "image"
    _plot(file[layout.OVERVIEW], "preview", ["pose", ".", "."])
    _plot(file[layout.RAW], "images", ["pose", "count_time", ".", "."])
    _plot(file[layout.QUALITY], "saturated_fraction", ["pose", "count_time"])
    file[layout.OVERVIEW].attrs["SILX_style"] = json.dumps({"signal_scale_type": "log"})
    file[layout.QUALITY].attrs["auxiliary_signals"] = ["black_fraction"]
    file[layout.LIGHT]["position"] = file[layout.LIGHT_OFFSET.path]


def _plot(group: h5py.Group, signal: str, axes: list[str]) -> None:
    group.attrs.update(signal=signal, axes=axes)
