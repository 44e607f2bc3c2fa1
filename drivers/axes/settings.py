"""What the rig file says of an axis, whatever moves it: `[[stage.device.axes]]`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Annotated, Literal, Self

from pydantic import Field, model_validator

from drivers.device_settings import DeviceSettings
from drivers.errors import DeviceLimitError
from drivers.limits import Limits
from drivers.stage import AxisDescription

Name = Annotated[str, Field(min_length=1)]

UNITS = {"rotation": "deg", "translation": "mm"}


class AxisSettings(DeviceSettings):
    """One axis; a driver adds how it is addressed, and what its units are."""

    name: Name = Field(description="as used in poses")
    kind: Literal["rotation", "translation"] = Field(description="degrees or millimetres")
    vector: tuple[float, float, float] = Field(
        description="unit vector of the axis, right-handed or of travel, in the frame of the axis that it rides on"
    )
    soft_limits: tuple[float, float] = Field(description="lowest and highest position, degrees or millimetres")
    tolerance: float = Field(gt=0.0, description="largest difference between target and read-back, degrees or mm")
    scale: float = Field(description="units of the device per degree or millimetre; negative turns the sense round")
    zero: float = Field(default=0.0, description="position, in units of the device, where the axis is at 0")

    def position_from_native(self, native: float) -> float:
        """Return the position in degrees or millimetres from one in units of the device."""
        return round((native - self.zero) / self.scale, 6) + 0.0

    def describe(self) -> AxisDescription:
        """Return what the rest of the program knows of the axis."""
        low, high = self.soft_limits
        return AxisDescription(self.name, self.kind, Limits(low, high, UNITS[self.kind]), self.tolerance, self.vector)

    @model_validator(mode="after")
    def _can_be(self) -> Self:
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
            yield "scale is 0; state the device's units per degree or millimetre"


def axes_problems(axes: Sequence[AxisSettings]) -> Iterator[str]:
    """Yield what the axes of a stage have against each other."""
    if not axes:
        yield "axes is empty; describe one at least"
    names = [axis.name for axis in axes]
    yield from (f"the name of two axes is {name}" for name in dict.fromkeys(names) if names.count(name) > 1)


def check_target(axes: Sequence[AxisSettings], target: Mapping[str, float]) -> None:
    """Refuse a target that names no axis of a stage, or leaves its soft limits.

    Raises
    ------
    DeviceLimitError
    """
    described = {axis.name: axis.describe() for axis in axes}
    for name, value in target.items():
        if name not in described:
            raise DeviceLimitError(f"the stage has no axis {name!r}; its axes are {', '.join(described)}")
        described[name].soft_limits.check(f"target of axis {name}", value, "Leave that pose out of the plan.")
