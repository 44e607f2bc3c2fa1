"""What the rig file says of the LED: its table `[light.device]`."""

from __future__ import annotations

from pydantic import Field

from drivers.device_settings import DeviceSettings
from drivers.lease import LONGEST_LEASE


class SysfsLedSettings(DeviceSettings):
    """An LED that the kernel drives."""

    led: str = Field(min_length=1, description="its name in the folder, e.g. sample-light")
    folder: str = Field(default="/sys/class/leds", description="where the kernel shows its LEDs")
    longest_lease_s: float = Field(default=LONGEST_LEASE, gt=0.0, description="that it may be told to shine at a time")
