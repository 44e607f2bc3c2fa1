"""A setting of a device: its value as read back, its unit, and what the device allows."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.errors import DeviceError
from drivers.limits import Limits


@dataclass(frozen=True, slots=True)
class Setting:
    """A value that a device reads back, with what it says that it allows.

    Attributes
    ----------
    name : str
        As in the rig file, without its unit.
    value : float or str
    unit : str
        E.g. ``"dB"``; ``""`` for a choice.
    limits : Limits, optional
        Of a number.
    choices : tuple of str
        Of a text.
    """

    name: str
    value: float | str
    unit: str = ""
    limits: Limits | None = None
    choices: tuple[str, ...] = ()

    def __str__(self) -> str:
        value = self.value if isinstance(self.value, str) else f"{self.value:g} {self.unit}".rstrip()
        if self.limits is not None:
            return f"{self.name} {value} ({self.limits.low:g} to {self.limits.high:g})"
        return f"{self.name} {value}"


def confirm(name: str, wanted: float, read_back: float, tolerance: float, unit: str) -> None:
    """Raise unless a device took the value that it was given.

    Parameters
    ----------
    wanted, read_back, tolerance : float
        In `unit`.

    Raises
    ------
    DeviceError
        With both values.
    """
    # NaN is no read-back either.
    if not abs(read_back - wanted) <= tolerance:
        raise DeviceError(
            f"{name} was set to {wanted:g} {unit} and reads back {read_back:g} {unit}. "
            "Take a value that the device keeps, or look at what else sets it."
        )
