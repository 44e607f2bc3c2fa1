"""How the axes of a stage hang on a GRBL controller: what rig.toml says of it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from drivers.errors import DeviceError
from drivers.limits import Limits
from drivers.stage import AxisDescription

LETTERS = "XYZABC"

_NEEDED = ("port", "axes")
_NEEDED_OF_AN_AXIS = ("name", "letter", "kind", "vector", "soft_limits", "tolerance")
# key of the table -> attribute
_OPTIONAL = {"baud_rate": "baud_rate", "homing": "homing", "settling_time_s": "settling_time"}

_UNITS = {"rotation": "deg", "translation": "mm"}


@dataclass(frozen=True, slots=True)
class GrblAxis:
    """One axis and the letter that moves it.

    Attributes
    ----------
    name : str
        As used in poses.
    letter : str
        Of the firmware: X, Y, Z, A, B or C.
    kind : {"rotation", "translation"}
    vector : tuple of float, length 3
        Unit vector of the axis, see `drivers.stage.AxisDescription`.
    soft_limits : tuple of float
        Lowest and highest position, degrees or millimetres.
    tolerance : float
        Largest difference between target and read-back, degrees or millimetres.
    scale : float
        Units of the firmware (which calls them millimetres) per degree or millimetre; negative turns the sense round.
    zero : float
        Machine position, in the firmware's units, where the axis stands at 0.
    """

    name: str
    letter: str
    kind: Literal["rotation", "translation"]
    vector: tuple[float, float, float]
    soft_limits: tuple[float, float]
    tolerance: float
    scale: float = 1.0
    zero: float = 0.0

    @property
    def i_letter(self) -> int:
        """Where the axis stands in the reports and settings of the firmware."""
        return LETTERS.index(self.letter)

    def machine_from_position(self, position: float) -> float:
        """Return the machine position, in the firmware's units, to the three decimals that it takes."""
        return round(self.zero + self.scale * position, 3) + 0.0

    def position_from_machine(self, machine: float) -> float:
        """Return the position in degrees or millimetres."""
        return round((machine - self.zero) / self.scale, 6) + 0.0

    def describe(self) -> AxisDescription:
        """Return what the rest of the program knows of the axis."""
        low, high = self.soft_limits
        limits = Limits(low, high, _UNITS[self.kind])
        return AxisDescription(self.name, self.kind, limits, self.tolerance, self.vector)

    def problems(self) -> Iterator[str]:
        """Yield what cannot be."""
        low, high = self.soft_limits
        if self.letter not in LETTERS or len(self.letter) != 1:
            yield f"letter is {self.letter!r}; allowed are {', '.join(LETTERS)}"
        if self.kind not in _UNITS:
            yield f"kind is {self.kind!r}; allowed are {', '.join(_UNITS)}"
        if abs(math.hypot(*self.vector) - 1.0) > 1e-6:
            yield f"vector has length {math.hypot(*self.vector):g}; it must be 1"
        if not low < high:
            yield f"soft_limits are {low:g} to {high:g}; the first must be the lower one"
        if not low <= 0.0 <= high:
            yield f"soft_limits are {low:g} to {high:g}; 0, where the axis is after homing, must lie between them"
        if not self.tolerance > 0.0:
            yield f"tolerance is {self.tolerance:g}; it must be above 0"
        if self.scale == 0.0:
            yield "scale is 0; state the firmware's units per degree or millimetre"


@dataclass(frozen=True, slots=True)
class GrblSettings:
    """A GRBL stage.

    Attributes
    ----------
    port : str
        Of the system, e.g. ``/dev/ttyACM0``.
    axes : tuple of GrblAxis
        From the base to the sample.
    baud_rate : int
    homing : bool
        True: limit switches find the zero (``$22=1``). False: the zero is where the axes stood when the controller
        was switched on, and homing goes back there.
    settling_time : float
        Seconds that the stage stands still before a move counts as done.

    Raises
    ------
    DeviceError
        With all that cannot be.
    """

    port: str
    axes: tuple[GrblAxis, ...]
    baud_rate: int = 115200
    homing: bool = True
    settling_time: float = 0.2

    def __post_init__(self) -> None:
        problems = [f"axis {axis.name}: {text}" for axis in self.axes for text in axis.problems()]
        problems += self._shared()
        if problems:
            raise DeviceError(f"the GRBL stage cannot be so: {'; '.join(problems)}. Correct [stage] in rig.toml.")

    @classmethod
    def from_table(cls, table: Mapping[str, Any]) -> GrblSettings:
        """Return the settings of a parsed ``[stage]`` table, see docs/devices.md.

        Raises
        ------
        DeviceError
            With all that cannot be.
        """
        problems = [*_missing(table, _NEEDED, "stage")]
        for i_axis, axis in enumerate(table.get("axes", ())):
            problems += _missing(axis, _NEEDED_OF_AN_AXIS, f"stage.axes[{i_axis}]")
            problems += _unknown(axis, f"stage.axes[{i_axis}]")
        if problems:
            raise DeviceError(f"{'; '.join(problems)}. See docs/devices.md.")
        stated = {name: table[key] for key, name in _OPTIONAL.items() if key in table}
        return cls(port=table["port"], axes=tuple(_axis(axis) for axis in table["axes"]), **stated)

    def _shared(self) -> Iterator[str]:
        if not self.axes:
            yield "it has no axes"
        for what in ("name", "letter"):
            values = [getattr(axis, what) for axis in self.axes]
            twice = sorted({value for value in values if values.count(value) > 1})
            if twice:
                yield f"the {what} of two axes is {', '.join(twice)}"
        if not self.settling_time >= 0.0:
            yield f"settling_time_s is {self.settling_time:g}; it must not be negative"


def _missing(table: Mapping[str, Any], needed: Sequence[str], where: str) -> Iterator[str]:
    yield from (f"{where}.{key} is missing" for key in needed if key not in table)


def _unknown(table: Mapping[str, Any], where: str) -> Iterator[str]:
    allowed = GrblAxis.__dataclass_fields__
    yield from (f"{where} has no key {key!r}" for key in table if key not in allowed)


def _axis(table: Mapping[str, Any]) -> GrblAxis:
    pairs = {"vector": tuple(table["vector"]), "soft_limits": tuple(table["soft_limits"])}
    return GrblAxis(**{**table, **pairs})
