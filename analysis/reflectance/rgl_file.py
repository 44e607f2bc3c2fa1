"""Files of the RGL database of measured BRDFs [dupuy2018]: read the isotropic ones in RGB.

A `.bsdf` file is a container of tensors: a header with the name, shape, type and place of each field, then their
values, all little-endian. Its mask `valid` is not read, since its bits mean measured in some of the files and not
measured in others; `rgb` is zero in all channels where nothing was measured.
"""

from __future__ import annotations

import math
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from analysis.reflectance.atoms import CHANNEL_NAMES
from analysis.reflectance.models import Array
from analysis.reflectance.rgl import RglBrdf
from instrument.files.validation import InvalidInputError, Problem, raise_if_any

SUFFIX = ".bsdf"

_MAGIC = b"tensor_file\0"

_VERSION = (1, 0)

_MOST_BYTES = 16_000_000  # an isotropic file in RGB has 0.7 MB

_FLOAT32, _UINT8 = 10, 1  # numbers of types in the header

_TYPES: dict[int, np.dtype[Any]] = {_FLOAT32: np.dtype("<f4"), _UINT8: np.dtype("u1")}

_HEAD, _PLACE = struct.Struct("<2BI"), struct.Struct("<HBQ")

_MOST_FIELDS, _MOST_AXES = 100, 8  # the database's files have 11 fields of up to 5

# What of a file is read; an axis is as long as the field, or the number, that it is called by, others at least 2.
_AXES = {
    "phi_i": ("phi_i",),
    "theta_i": ("theta_i",),
    "sigma": ("phi", "theta"),
    "ndf": ("phi", "theta"),
    "vndf": ("phi_i", "theta_i", "phi", "theta"),
    "rgb": ("phi_i", "theta_i", "3", "v", "u"),
    "jacobian": ("1",),
}

_ABSURD = 1e9  # no value of a field, nor one over sigma, comes near it

_AGAIN = "the file is damaged, fetch it again"


def read_rgl(path: Path) -> RglBrdf:
    """Read an isotropic RGB file; nothing but its header before the sizes that it states are known to be true.

    Raises
    ------
    InvalidInputError
        With everything that is wrong.
    """
    title = f"{path} cannot be read as a material of the RGL database."
    try:
        n_bytes = path.stat().st_size
        with path.open("rb") as file:
            fields = _read_header(file, path, title)
            raise_if_any(title, _header_problems(path, fields, n_bytes))
            values = {name: _read_values(file, fields[name]) for name in _AXES}
    except OSError as error:
        raise InvalidInputError(title, [Problem(str(path), error.strerror or str(error))]) from None
    raise_if_any(title, _value_problems(path, values))
    # Of two phi_i, each is an end of the one turn over which nothing changes.
    return RglBrdf(
        theta_i=values["theta_i"],
        sigma=values["sigma"].mean(axis=0),
        ndf=values["ndf"].mean(axis=0),
        vndf=values["vndf"][0],
        rgb=values["rgb"][0],
        jacobian=bool(values["jacobian"][0]),
    )


@dataclass(frozen=True, slots=True)
class _Field:
    """Where a tensor lies in the file."""

    shape: tuple[int, ...]
    dtype: int
    offset: int

    @property
    def end(self) -> int:
        return self.offset + math.prod(self.shape) * _TYPES[self.dtype].itemsize


def _read_header(file: BinaryIO, path: Path, title: str) -> dict[str, _Field]:
    """Read the fields' names and places; stops at what does not let it go on."""

    def refuse(what: str) -> InvalidInputError:
        return InvalidInputError(title, [Problem(str(path), what)])

    def take(n: int) -> bytes:
        taken = file.read(n)
        if len(taken) < n:
            raise refuse("ends within its header: it was cut short or not copied whole; fetch it again")
        return taken

    if file.read(len(_MAGIC)) != _MAGIC:
        raise refuse("does not begin with 'tensor_file': no file of the RGL database, or a damaged one")
    *version, n_fields = _HEAD.unpack(take(_HEAD.size))
    if tuple(version) != _VERSION:
        raise refuse(f"is of version {version[0]}.{version[1]} of its format; 1.0 is read")
    if n_fields > _MOST_FIELDS:
        raise refuse(f"states {n_fields} fields; the database's files have 11: it is damaged, fetch it again")
    fields: dict[str, _Field] = {}
    for _ in range(n_fields):
        name = take(int.from_bytes(take(2), "little")).decode("utf-8", "replace")
        n_axes, dtype, offset = _PLACE.unpack(take(_PLACE.size))
        if n_axes > _MOST_AXES or name in fields:
            what = f"has {n_axes} axes" if n_axes > _MOST_AXES else "is there twice"
            raise refuse(f"field {name[:40]!r} {what}: the header is damaged, fetch the file again")
        fields[name] = _Field(struct.unpack(f"<{n_axes}Q", take(8 * n_axes)), dtype, offset)
    return fields


def _header_problems(path: Path, fields: dict[str, _Field], n_bytes: int) -> Iterator[Problem]:
    if n_bytes > _MOST_BYTES:
        yield Problem(str(path), f"has {n_bytes} bytes; up to {_MOST_BYTES} are read, isotropic RGB files have 0.7 MB")
    if "rgb" not in fields and "spectra" in fields:
        what = "holds spectra; only files in RGB are read. Fetch the one of the same material whose name ends in _rgb"
        yield Problem(str(path), what)
    else:
        missing = [name for name in _AXES if name not in fields]
        if missing:
            yield Problem(str(path), f"has no field {', '.join(missing)}; needed are {', '.join(_AXES)}")
    phi_i = fields.get("phi_i")
    if phi_i and phi_i.shape and phi_i.shape[0] > 2:
        what = f"is anisotropic ({phi_i.shape[0]} phi_i); only isotropic materials, with one or two, are read"
        yield Problem(str(path), what)
    for name in _AXES:
        if name in fields:
            yield from _field_problems(path, name, fields, n_bytes)


def _field_problems(path: Path, name: str, fields: dict[str, _Field], n_bytes: int) -> Iterator[Problem]:
    field, axes = fields[name], _AXES[name]
    needed = _UINT8 if name == "jacobian" else _FLOAT32
    if field.dtype != needed:
        yield Problem(str(path), f"{name} is of type {field.dtype}; must be {needed} ({_TYPES[needed].name})")
    elif field.end > n_bytes:
        what = f"{name} would end at byte {field.end} of {n_bytes}: the file was cut short, or its header is damaged"
        yield Problem(str(path), what)
    if len(field.shape) != len(axes):
        yield Problem(str(path), f"{name} has shape {field.shape}; must be ({', '.join(axes)})")
        return
    for axis, size in zip(axes, field.shape, strict=True):
        wrong = _length_problem(axis, size, None if axis == name else fields.get(axis))
        if wrong:
            yield Problem(str(path), f"{name} has shape {field.shape}; {wrong} along {axis}")


def _length_problem(axis: str, size: int, of_axis: _Field | None) -> str | None:
    """Return what the length of an axis must be, if it is not so; `of_axis` is the field that the axis is called by."""
    if axis.isdecimal() or (of_axis and of_axis.shape):
        needed = of_axis.shape[0] if of_axis else int(axis)
        return f"must have {needed}" if size != needed else None
    least = 1 if axis == "phi_i" else 2
    return f"must have at least {least}" if size < least else None


def _read_values(file: BinaryIO, field: _Field) -> Array:
    file.seek(field.offset)
    kind = _TYPES[field.dtype]
    content = file.read(math.prod(field.shape) * kind.itemsize)
    if field.offset + len(content) < field.end:
        raise OSError("became shorter while it was being read")
    with np.errstate(invalid="ignore"):  # NaN of the kind that signals; counted in `_value_problems`
        return np.asarray(np.frombuffer(content, kind).reshape(field.shape), np.float64)


def _value_problems(path: Path, values: dict[str, Array]) -> Iterator[Problem]:
    bad = {name: int(np.count_nonzero(~(np.abs(field) < _ABSURD))) for name, field in values.items()}
    for name, n in bad.items():
        if n:
            yield Problem(str(path), f"{name}: {n} of {values[name].size} values are not finite, or absurd; {_AGAIN}")
    if any(bad.values()):
        return
    theta_i = values["theta_i"]
    if np.any(np.diff(theta_i) <= 0.0) or theta_i[0] < 0.0 or theta_i[-1] > np.pi / 2.0 + 1e-6:
        yield Problem(str(path), f"theta_i must ascend within 0 to pi / 2; {_AGAIN}")
    if values["sigma"].min() < 1.0 / _ABSURD:
        yield Problem(str(path), f"sigma must be positive everywhere; {_AGAIN}")
    for name in ("ndf", "vndf"):
        if values[name].min() < 0.0:
            yield Problem(str(path), f"{name} is negative somewhere; a density is not: {_AGAIN}")
    empty = ~np.any(values["vndf"] > 0.0, axis=(2, 3))
    if empty.any():
        yield Problem(str(path), f"vndf is 0 for {np.count_nonzero(empty)} of {theta_i.size} theta_i; {_AGAIN}")
    for channel, name in enumerate(CHANNEL_NAMES):
        if not np.any(values["rgb"][:, :, channel] > 0.0):
            yield Problem(str(path), f"no value of {name} is positive: nothing of it was measured")
