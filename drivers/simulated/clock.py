"""A clock on which nobody has to wait."""

from __future__ import annotations


class VirtualClock:
    """A clock on which sleeping takes no time: tests and demos run as fast as they render.

    Parameters
    ----------
    start : float
        Seconds that it shows at first.
    """

    def __init__(self, start: float = 0.0) -> None:
        self._now = start

    def now(self) -> float:
        """Return the seconds that were slept so far, plus the start."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Advance by `seconds` at once."""
        if not seconds >= 0.0:
            raise ValueError(f"cannot sleep for {seconds} s; allowed is 0 s or more")
        self._now += seconds
