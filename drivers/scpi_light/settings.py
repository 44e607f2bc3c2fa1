"""What the rig file says of a LED controller that speaks SCPI."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from pydantic import Field

from drivers.device_settings import DeviceSettings
from drivers.lease import LONGEST_LEASE


@dataclass(frozen=True, slots=True)
class UsbAddress:
    """Which USB device is meant.

    Attributes
    ----------
    vendor_id, product_id : int
        As the device itself reports them.
    serial_number : str
        Of the one device allowed; empty = the only one that is plugged in.
    """

    vendor_id: int
    product_id: int
    serial_number: str = ""

    def __str__(self) -> str:
        serial = f", serial number {self.serial_number}" if self.serial_number else ""
        return f"{self.vendor_id:04x}:{self.product_id:04x}{serial}"


class ScpiLightSettings(DeviceSettings):
    """`[light.device]` of a LED controller with the commands of Thorlabs' DC2200."""

    # A DC2200 drives up to 10 A; what its LED bears is less, and is the current limit's to say.
    max_current_a: float = Field(
        ge=0.001, le=10.0, description="current of level 1 in A, from the LED's data sheet; the controller's own limit"
    )
    terminal: Literal[1, 2] = Field(default=1, description="connector of the LED: 1 (10 A, 12 pins), 2 (2 A, 4 pins)")
    model: str = Field(default="DC2200", min_length=1, description="what *IDN? has to contain")
    vendor_id: int = Field(default=0x1313, ge=0, le=0xFFFF, description="USB vendor")
    product_id: int = Field(default=0x80C8, ge=0, le=0xFFFF, description="USB product")
    # A supervisor waits for 4 s: one time limit, and one more to clear the device, have to fit into that.
    answer_time_s: float = Field(default=1.0, ge=0.05, le=1.5, description="that it has for an answer; 1 s is ample")
    # A thousand pulses of 10 s each.
    longest_lease_s: float = Field(
        default=LONGEST_LEASE, ge=0.001, le=10_000.0, description="that it may be told to shine at a time"
    )
