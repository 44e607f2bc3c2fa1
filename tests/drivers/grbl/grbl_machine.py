"""The axes behind the double of a GRBL controller: motions that take their time, stepped one millisecond at a time."""

from __future__ import annotations

import math

_STEP = 0.001  # seconds


class GrblMachine:
    """Three axes that start, run and brake with finite acceleration.

    Position, speed and acceleration are in the controller's units, along the straight way of the motion under way.
    """

    def __init__(self, settings: dict[int, float]) -> None:
        self._settings = settings
        self.position = [0.0, 0.0, 0.0]
        self.queue: list[tuple[list[float], float]] = []  # (target, units per second)
        self.speed = 0.0
        self.braking = False
        self._owed = 0.0  # seconds that are less than a step

    @property
    def moving(self) -> bool:
        return self.speed > 0.0

    def cut(self) -> None:
        """Take the steps away at once."""
        self.queue.clear()
        self.speed, self.braking = 0.0, False

    def pass_time(self, seconds: float) -> None:
        n_steps, self._owed = divmod(self._owed + seconds, _STEP)
        for _ in range(int(n_steps)):
            if not self.queue or (self.braking and self.speed == 0.0):
                return
            self._step(*self.queue[0])

    def _step(self, target: list[float], feed: float) -> None:
        way = [end - here for end, here in zip(target, self.position, strict=True)]
        remaining = math.hypot(*way)
        if remaining < 1e-9:
            self._arrive(target)
            return
        shares = [abs(part) / remaining for part in way]
        fastest = min(feed, self._along(110, shares) / 60.0)
        acceleration = self._along(120, shares)
        if self.braking:
            self.speed = max(0.0, self.speed - acceleration * _STEP)
        else:
            self.speed = min(self.speed + acceleration * _STEP, fastest, math.sqrt(2.0 * acceleration * remaining))
        made = self.speed * _STEP
        if made >= remaining or (not self.braking and remaining < 0.5 * acceleration * _STEP**2):
            self._arrive(target)
            return
        self.position = [here + part * made / remaining for here, part in zip(self.position, way, strict=True)]

    def _arrive(self, target: list[float]) -> None:
        self.position = list(target)
        self.queue.pop(0)
        self.speed = 0.0

    def _along(self, first: int, shares: list[float]) -> float:
        return min(self._settings[first + i] / share for i, share in enumerate(shares) if share > 1e-12)
