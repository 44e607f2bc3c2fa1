"""Reads the stage of a session: its axes, from the base to the sample."""

from __future__ import annotations

from typing import Literal

import numpy as np

from instrument.files.untrusted import HDF5_ERRORS, text_attribute
from instrument.files.validation import InvalidInputError, Problem
from instrument.session import layout
from instrument.session.nominal import StatedReader
from instrument.session.records import AxisRecord
from instrument.session.structure import axis_names

_KINDS: dict[str | None, Literal["rotation", "translation"]] = {"rotation": "rotation", "translation": "translation"}


class AxesReader(StatedReader):
    """A session file, as far as it says how the stage could move the sample."""

    @property
    def axes(self) -> tuple[AxisRecord, ...]:
        """The stage's axes, from the base to the sample; none for an import.

        Raises
        ------
        InvalidInputError
            If the file does not say how they ride on each other.
        """
        below = {self._rides_on(name): name for name in axis_names(self._file)}
        chain, at = list[AxisRecord](), "."
        while at in below:
            name = below.pop(at)
            chain.append(self._axis(name))
            at = f"{layout.TRANSFORMATIONS}/{name}"
        if below:
            raise self._broken(next(iter(below.values())), "depends_on leads to no base")
        return tuple(chain)

    def _rides_on(self, name: str) -> str:
        value = self._file[layout.axis_field(name, "value").path]
        return text_attribute(value, "depends_on") or ""

    def _axis(self, name: str) -> AxisRecord:
        value = self._file[layout.axis_field(name, "value").path]
        kind = _KINDS.get(text_attribute(value, "transformation_type"))
        try:
            x, y, z = np.asarray(value.attrs["vector"], np.float64)
        except (*HDF5_ERRORS, TypeError) as error:
            raise self._broken(name, f"vector cannot be read: {error}") from error
        if kind is None or not np.isfinite([x, y, z]).all():
            raise self._broken(name, "transformation_type or vector is none")
        low, high, tolerance = (
            self._scalar(layout.axis_field(name, part)) for part in ("soft_limit_min", "soft_limit_max", "tolerance")
        )
        return AxisRecord(name, kind, low, high, tolerance, (float(x), float(y), float(z)))

    def _broken(self, name: str, why: str) -> InvalidInputError:
        problem = Problem(layout.axis_field(name, "value").path, why)
        return InvalidInputError(f"{self.path} does not say how its stage stood", [problem])
