"""Clocks: the simulated devices never ask the computer for the time."""

from __future__ import annotations

import time
from threading import Event
from typing import Protocol, runtime_checkable

LONGEST_NAP = 0.05
"""Seconds a simulated motion or exposure sleeps before it looks whether it was stopped."""


@runtime_checkable
class Clock(Protocol):
    """Monotonic seconds, and a way to let them pass."""

    def now(self) -> float:
        """Return the seconds since an arbitrary start."""

    def sleep(self, seconds: float) -> None:
        """Return after `seconds` have passed on this clock."""


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


class RealClock:
    """The computer's monotonic clock, for demonstrations in real time."""

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
