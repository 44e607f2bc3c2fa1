"""What the rig file says of a LED controller that speaks SCPI."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.lease import LONGEST_LEASE
from drivers.limits import Limits

TERMINALS = (1, 2)
# A DC2200 drives up to 10 A; what its LED bears is less, and is the current limit's to say.
MAX_CURRENT = Limits(0.001, 10.0, "A")
# A supervisor waits for 4 s: one time limit, and one more to clear the device, have to fit into that.
ANSWER_TIME = Limits(0.05, 1.5, "s")
# A thousand pulses of 10 s each.
LEASE = Limits(0.001, 10_000.0, "s")


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


@dataclass(frozen=True, slots=True)
class ScpiLightSettings:
    """A LED controller with the commands of Thorlabs' DC2200.

    Attributes
    ----------
    max_current : float
        Current of level 1 in A; the driver makes it the controller's own current limit.
    terminal : int
        Connector of the LED: 1 (10 A, 12 pins) or 2 (2 A, 4 pins).
    serial_number : str
        Of the one controller allowed; empty = the only one that is plugged in.
    model : str
        What ``*IDN?`` has to contain.
    vendor_id, product_id : int
        USB ids.
    answer_time : float
        Seconds that the controller has for an answer.
    longest_lease : float
        Seconds that it may be told to shine at a time.
    """

    max_current: float
    terminal: int = 1
    serial_number: str = ""
    model: str = "DC2200"
    vendor_id: int = 0x1313
    product_id: int = 0x80C8
    answer_time: float = 1.0
    longest_lease: float = LONGEST_LEASE

    def __post_init__(self) -> None:
        """Refuse values that no controller takes."""
        MAX_CURRENT.check("max_current", self.max_current, "Take it from the LED's data sheet.")
        ANSWER_TIME.check("answer_time", self.answer_time, "1 s is ample.")
        LEASE.check("longest_lease", self.longest_lease, "Take what one bracket needs.")
        if self.terminal not in TERMINALS:
            raise ValueError(f"terminal is {self.terminal}; allowed are 1 (10 A, 12 pins) and 2 (2 A, 4 pins)")

    @property
    def address(self) -> UsbAddress:
        """Which USB device is meant."""
        return UsbAddress(self.vendor_id, self.product_id, self.serial_number)
