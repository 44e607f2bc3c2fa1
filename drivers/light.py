"""What halfangle asks of a light."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from drivers.limits import Limits
from drivers.readback import Setting


@dataclass(frozen=True, slots=True)
class LightDescription:
    """What does not change while a light is connected; `settings` as it reads back."""

    make: str
    model: str
    serial_number: str
    level_limits: Limits
    firmware: str = ""
    settings: tuple[Setting, ...] = ()


@dataclass(frozen=True, slots=True)
class LightState:
    """One read-back of a light.

    Attributes
    ----------
    lit : bool
        Whether it shines now.
    level : float
        Level as read back (relative, 0 to 1).
    monitor : float
        Reading of the light's own photodiode, relative; NaN where it has none.
    temperature : float
        Degrees Celsius; NaN where the light has no sensor for it.
    """

    lit: bool
    level: float
    monitor: float
    temperature: float


@runtime_checkable
class Light(Protocol):
    """A light that shines under a lease and goes dark by itself when that ends.

    Every method raises `drivers.errors.DeviceError` (or a subclass) when the device fails.
    """

    def connect(self) -> None:
        """Open the device, dark; safe to call twice."""

    def disconnect(self) -> None:
        """Switch off and close; safe to call twice, and without `connect`."""

    def describe(self) -> LightDescription:
        """Return what the connected light is."""

    def on(self, level: float, max_seconds: float) -> LightState:
        """Shine at `level` for at most `max_seconds`, then go dark unless told again.

        Raises
        ------
        DeviceLimitError
            If `level` is outside the limits or `max_seconds` is not positive.
        """

    def off(self) -> LightState:
        """Go dark and confirm it; safe to call at any time."""

    def read(self) -> LightState:
        """Return the state as the device reports it."""
