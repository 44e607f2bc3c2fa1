"""How the axes of a stage hang on Zaber's devices: what rig.toml says of it."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Literal

from pydantic import Field, model_validator

from drivers.limits import Limits
from drivers.settings import DeviceSettings
from drivers.stage import AxisDescription

UNITS = {"rotation": "deg", "translation": "mm"}

Name = Annotated[str, Field(min_length=1)]


class ZaberAxis(DeviceSettings):
    """`[[stage.device.axes]]`: one axis, and the device that moves it."""

    name: Name = Field(description="as used in poses")
    device_address: int = Field(default=1, ge=1, le=99, description="of the device in its chain")
    axis_number: int = Field(default=1, ge=1, le=9, description="of the axis on its device")
    kind: Literal["rotation", "translation"] = Field(description="degrees or millimetres")
    vector: tuple[float, float, float] = Field(
        description="unit vector of the axis, right-handed or of travel, in the frame of the axis that it rides on"
    )
    soft_limits: tuple[float, float] = Field(description="lowest and highest position, degrees or millimetres")
    tolerance: float = Field(gt=0.0, description="largest difference between target and read-back, degrees or mm")
    scale: float = Field(
        description="the device's units (microsteps) per degree or millimetre; negative turns the sense round"
    )
    zero: float = Field(default=0.0, description="position, in the device's units, where the axis is at 0")

    @property
    def place(self) -> tuple[int, int]:
        """Address of the device, and number of the axis there."""
        return self.device_address, self.axis_number

    def native_from_position(self, position: float) -> int:
        """Return the position in the device's units, which are whole."""
        return round(self.zero + self.scale * position)

    def position_from_native(self, native: float) -> float:
        """Return the position in degrees or millimetres."""
        return round((native - self.zero) / self.scale, 6) + 0.0

    def describe(self) -> AxisDescription:
        """Return what the rest of the program knows of the axis."""
        low, high = self.soft_limits
        return AxisDescription(self.name, self.kind, Limits(low, high, UNITS[self.kind]), self.tolerance, self.vector)

    @model_validator(mode="after")
    def _can_be(self) -> ZaberAxis:
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
            yield "scale is 0; state the device's microsteps per degree or millimetre"


class ZaberSettings(DeviceSettings):
    """`[stage.device]` of a stage of Zaber's devices."""

    port: Name = Field(description="of the system, e.g. /dev/serial/by-id/usb-...")
    axes: Annotated[tuple[ZaberAxis, ...], Field(min_length=1)] = Field(description="from the base to the sample")
    baud_rate: int = Field(default=115200, ge=9600, le=115200, description="of the chain")
    settling_time_s: float = Field(
        default=0.2, ge=0.0, le=60.0, description="that the stage stands still before a move counts as done"
    )

    @property
    def addresses(self) -> tuple[int, ...]:
        """Addresses of the devices, each once, from the base to the sample."""
        return tuple(dict.fromkeys(axis.device_address for axis in self.axes))

    @model_validator(mode="after")
    def _axes_differ(self) -> ZaberSettings:
        names, places = [axis.name for axis in self.axes], [axis.place for axis in self.axes]
        problems = [f"the name of two axes is {name}" for name in dict.fromkeys(names) if names.count(name) > 1]
        problems += [
            f"two axes are axis {number} of device {address}"
            for address, number in dict.fromkeys(places)
            if places.count((address, number)) > 1
        ]
        if problems:
            raise ValueError("; ".join(problems))
        return self
