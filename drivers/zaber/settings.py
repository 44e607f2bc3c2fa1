"""How the axes of a stage hang on Zaber's devices: what rig.toml says of it."""

from __future__ import annotations

from pydantic import Field, model_validator

from drivers.axes.settings import AxisSettings, Name, axes_problems
from drivers.device_settings import DeviceSettings


class ZaberAxis(AxisSettings):
    """One axis, and the device that moves it; a device's units are its microsteps."""

    device_address: int = Field(default=1, ge=1, le=99, description="of the device in its chain")
    axis_number: int = Field(default=1, ge=1, le=9, description="of the axis on its device")

    @property
    def place(self) -> tuple[int, int]:
        """Address of the device, and number of the axis there."""
        return self.device_address, self.axis_number

    def native_from_position(self, position: float) -> int:
        """Return the position in the device's units, which are whole."""
        return round(self.zero + self.scale * position)


class ZaberSettings(DeviceSettings):
    """`[stage.device]` of a stage of Zaber's devices."""

    port: Name = Field(description="of the system, e.g. /dev/serial/by-id/usb-...")
    axes: tuple[ZaberAxis, ...] = Field(description="from the base to the sample")
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
        places = [axis.place for axis in self.axes]
        problems = [*axes_problems(self.axes)]
        problems += [
            f"two axes are axis {number} of device {address}"
            for address, number in dict.fromkeys(places)
            if places.count((address, number)) > 1
        ]
        if problems:
            raise ValueError("; ".join(problems))
        return self
