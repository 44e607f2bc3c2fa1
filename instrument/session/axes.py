"""Reads the stage of a session: its axes, from the base to the sample."""

from __future__ import annotations

from typing import Literal

import numpy as np

from instrument.files.untrusted import HDF5_ERRORS, text_attribute
from instrument.files.validation import InvalidInputError, Problem
from instrument.session import layout
from instrument.session.reader import SessionReader
from instrument.session.records import AxisRecord
from instrument.session.structure import axis_names

_KINDS: dict[str | None, Literal["rotation", "translation"]] = {"rotation": "rotation", "translation": "translation"}


def read_axes(reader: SessionReader) -> tuple[AxisRecord, ...]:
    """Return the stage's axes, from the base to the sample; none for an import.

    Raises
    ------
    InvalidInputError
        If the file does not say how they ride on each other.
    """
    below = {_rides_on(reader, name): name for name in axis_names(reader.file)}
    chain, at = list[AxisRecord](), "."
    while at in below:
        name = below.pop(at)
        chain.append(_axis(reader, name))
        at = f"{layout.TRANSFORMATIONS}/{name}"
    if below:
        raise _broken(reader, next(iter(below.values())), "depends_on leads to no base")
    return tuple(chain)


def _rides_on(reader: SessionReader, name: str) -> str:
    value = reader.file[layout.axis_field(name, "value").path]
    return text_attribute(value, "depends_on") or ""


def _axis(reader: SessionReader, name: str) -> AxisRecord:
    value = reader.file[layout.axis_field(name, "value").path]
    kind = _KINDS.get(text_attribute(value, "transformation_type"))
    try:
        x, y, z = np.asarray(value.attrs["vector"], np.float64)
    except (*HDF5_ERRORS, TypeError) as error:
        raise _broken(reader, name, f"vector cannot be read: {error}") from error
    if kind is None or not np.isfinite([x, y, z]).all():
        raise _broken(reader, name, "transformation_type or vector is none")
    low, high, tolerance = (
        reader.scalar(layout.axis_field(name, part)) for part in ("soft_limit_min", "soft_limit_max", "tolerance")
    )
    return AxisRecord(name, kind, low, high, tolerance, (float(x), float(y), float(z)))


def _broken(reader: SessionReader, name: str, why: str) -> InvalidInputError:
    problem = Problem(layout.axis_field(name, "value").path, why)
    return InvalidInputError(f"{reader.path} does not say how its stage stood", [problem])
