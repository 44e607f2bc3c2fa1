"""Clocks: devices and the engine never ask the computer for the time themselves."""

from __future__ import annotations

import time
from threading import Event
from typing import Protocol, runtime_checkable

LONGEST_NAP = 0.05
"""Seconds that anyone sleeps before looking whether the wait was called off."""


@runtime_checkable
class Clock(Protocol):
    """Monotonic seconds, and a way to let them pass."""

    def now(self) -> float:
        """Return the seconds since an arbitrary start."""

    def sleep(self, seconds: float) -> None:
        """Return after `seconds` have passed on this clock."""


class RealClock:
    """The computer's monotonic clock, which no change of the wall time moves."""

    def now(self) -> float:
        """Return the computer's monotonic seconds."""
        return time.monotonic()

    def sleep(self, seconds: float) -> None:
        """Wait for `seconds`."""
        time.sleep(seconds)


def sleep_unless(stopped: Event, clock: Clock, seconds: float) -> bool:
    """Sleep in short naps; return False as soon as `stopped` is set.

    Parameters
    ----------
    stopped : threading.Event
        Set by another thread to end the wait.
    clock : Clock
        Whose seconds pass.
    seconds : float
        How long, if nothing stops it.
    """
    end = clock.now() + seconds
    while not stopped.is_set():
        remaining = end - clock.now()
        if remaining <= 0.0:
            return True
        clock.sleep(min(remaining, LONGEST_NAP))
    return False
