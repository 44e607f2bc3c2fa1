"""How the axes of a stage hang on a GRBL controller: what rig.toml says of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, model_validator

from drivers.limits import Limits
from drivers.settings import DeviceSettings
from drivers.stage import AxisDescription

LETTERS = "XYZABC"

_UNITS = {"rotation": "deg", "translation": "mm"}

Name = Annotated[str, Field(min_length=1)]


class GrblAxis(DeviceSettings):
    """`[[stage.device.axes]]`: one axis and the letter that moves it."""

    name: Name = Field(description="as used in poses")
    letter: Literal["X", "Y", "Z", "A", "B", "C"] = Field(description="of the firmware")
    kind: Literal["rotation", "translation"] = Field(description="degrees or millimetres")
    vector: tuple[float, float, float] = Field(
        description="unit vector of the axis, right-handed or of travel, in the frame of the axis that it rides on"
    )
    soft_limits: tuple[float, float] = Field(description="lowest and highest position, degrees or millimetres")
    tolerance: float = Field(gt=0.0, description="largest difference between target and read-back, degrees or mm")
    scale: float = Field(
        default=1.0,
        description="units of the firmware (its mm) per degree or millimetre; negative turns the sense round",
    )
    zero: float = Field(default=0.0, description="machine position, in the firmware's units, where the axis is at 0")

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

    @model_validator(mode="after")
    def _can_be(self) -> GrblAxis:
        problems = list(self._problems())
        if problems:
            raise ValueError("; ".join(problems))
        return self

    def _problems(self) -> Iterator[str]:
        low, high = self.soft_limits
        if abs(math.hypot(*self.vector) - 1.0) > 1e-6:
            yield f"vector has length {math.hypot(*self.vector):g}; it must be 1"
        if not low < high:
            yield f"soft_limits are {low:g} to {high:g}; the first must be the lower one"
        elif not low <= 0.0 <= high:
            yield f"soft_limits are {low:g} to {high:g}; 0, where the axis is after homing, must lie between them"
        if self.scale == 0.0:
            yield "scale is 0; state the firmware's units per degree or millimetre"


class GrblSettings(DeviceSettings):
    """`[stage.device]` of a GRBL stage."""

    port: Name = Field(description="of the system, e.g. /dev/serial/by-id/usb-...")
    axes: tuple[GrblAxis, ...] = Field(description="from the base to the sample")
    baud_rate: int = Field(default=115200, ge=300, le=4_000_000, description="of the firmware; 115200 for GRBL 1.1")
    homing: bool = Field(
        default=True,
        description="true: limit switches find the zero ($22=1); false: it is where the axes stood at power-up",
    )
    settling_time_s: float = Field(
        default=0.2, ge=0.0, le=60.0, description="that the stage stands still before a move counts as done"
    )

    @model_validator(mode="after")
    def _axes_differ(self) -> GrblSettings:
        problems = [*self._twice("name"), *self._twice("letter")]
        if not self.axes:
            problems.append("axes is empty; describe one at least")
        if problems:
            raise ValueError("; ".join(problems))
        return self

    def _twice(self, what: str) -> Iterator[str]:
        values = [getattr(axis, what) for axis in self.axes]
        twice = sorted({value for value in values if values.count(value) > 1})
        if twice:
            yield f"the {what} of two axes is {', '.join(twice)}"
