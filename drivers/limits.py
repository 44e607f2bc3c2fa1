"""Closed intervals that a device allows, and the message when one is left."""

from __future__ import annotations

from dataclasses import dataclass

from drivers.errors import DeviceLimitError


@dataclass(frozen=True, slots=True)
class Limits:
    """Closed interval ``[low, high]`` of a quantity, with its unit.

    Attributes
    ----------
    low, high : float
        Smallest and largest value allowed, both included.
    unit : str
        Unit of both, as written in messages, e.g. ``"s"``.
    """

    low: float
    high: float
    unit: str

    def __contains__(self, value: float) -> bool:
        return self.low <= value <= self.high

    def check(self, name: str, value: float, remedy: str) -> None:
        """Raise unless `value` lies inside; NaN never does.

        Raises
        ------
        DeviceLimitError
            With what, which, what is allowed and what next.
        """
        if value not in self:
            raise DeviceLimitError(
                f"{name} is {value:g} {self.unit}; allowed is {self.low:g} to {self.high:g} {self.unit}. {remedy}"
            )
