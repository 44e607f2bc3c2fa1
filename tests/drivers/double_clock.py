"""Clocks for a driver that talks to a double: however busy the computer, nobody runs out of time."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

HANG = 120.0
"""Seconds of the computer's that no wait of a test takes, unless something hangs."""

_MAX_TICK = 0.02


class DoubleClock:
    """Seconds in which a double was at work.

    Where the computer lets the double wait, its clock waits too: a limit of the driver that counts by it is over only
    when the double has had that time to answer. When the double is gone, sleeping makes time pass, and nothing else.
    """

    def __init__(self) -> None:
        self._now = 0.0
        self._ended = False
        self._passes = threading.Condition()
        self._before = time.monotonic()

    def tick(self) -> float:
        """Let pass what passed since the last tick, but not long; return it. For the double's thread."""
        now = time.monotonic()
        seconds, self._before = min(now - self._before, _MAX_TICK), now
        with self._passes:
            self._now += seconds
            self._passes.notify_all()
        return seconds

    def end(self) -> None:
        """Say that the double ticks no more."""
        with self._passes:
            self._ended = True
            self._passes.notify_all()

    def now(self) -> float:
        """Return the seconds so far."""
        return self._now

    def sleep(self, seconds: float) -> None:
        """Return after `seconds` have passed on this clock."""
        end = self._now + seconds
        with self._passes:
            assert self._passes.wait_for(lambda: self._ended or self._now >= end, HANG), "the double ticks no more"
            self._now = max(self._now, end)


class HastyClock:
    """Seconds of another clock that pass `rate` times as fast, so that a limit is soon over."""

    def __init__(self, clock: DoubleClock, rate: float) -> None:
        self._clock, self._rate = clock, rate

    def now(self) -> float:
        """Return the seconds so far."""
        return self._rate * self._clock.now()

    def sleep(self, seconds: float) -> None:
        """Return after `seconds` have passed on this clock."""
        self._clock.sleep(seconds / self._rate)


def until(holds: Callable[[], bool]) -> None:
    """Wait for something that comes unless something hangs."""
    end = time.monotonic() + HANG
    while not holds():
        assert time.monotonic() < end, "it did not come to that"
        time.sleep(0.002)
