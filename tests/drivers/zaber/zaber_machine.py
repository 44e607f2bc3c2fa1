"""How the axes of a double of Zaber's devices move: speed is a trapezoid over time."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

SPEED_UNITS = 1.6384


@dataclass(frozen=True)
class Profile:
    """A motion from `start`, begun at `began` with `entry_speed`, along `way`; seconds and microsteps."""

    began: float
    start: float
    way: float
    max_speed: float
    acceleration: float
    entry_speed: float = 0.0  # a brake, if not 0

    @property
    def ramp(self) -> float:
        return min(self.max_speed / self.acceleration, math.sqrt(abs(self.way) / self.acceleration))

    @property
    def duration(self) -> float:
        if self.entry_speed:
            return self.entry_speed / self.acceleration
        return abs(self.way) / (self.acceleration * self.ramp) + self.ramp if self.way else 0.0

    def position(self, now: float) -> float:
        return self.start + math.copysign(self._covered(min(now - self.began, self.duration)), self.way)

    def speed(self, now: float) -> float:
        passed = now - self.began
        if self.entry_speed:
            return max(0.0, self.entry_speed - self.acceleration * passed)
        return self.acceleration * max(0.0, min(passed, self.ramp, self.duration - passed))

    def _covered(self, passed: float) -> float:
        if self.entry_speed:
            return self.entry_speed * passed - self.acceleration * passed**2 / 2
        ramp, left = self.ramp, self.duration - passed
        if passed < ramp:
            return self.acceleration * passed**2 / 2
        if left < ramp:
            return abs(self.way) - self.acceleration * left**2 / 2
        return self.acceleration * ramp * (passed - ramp / 2)


@dataclass
class AxisMachine:
    """One axis; `settings` are the device's, in its units."""

    settings: dict[str, float]
    flags: set[str] = field(default_factory=set)
    sensor_is_missing: bool = False
    stalls: bool = False  # half way through the next motion
    loses_steps: float = 0.0  # microsteps, at the end of each motion
    homing: bool = False
    profile: Profile = Profile(0.0, 0.0, 0.0, 1.0, 1.0)

    def position(self, now: float) -> float:
        return self.profile.position(now)

    def is_busy(self, now: float) -> bool:
        self._settle(now)
        return now < self.profile.began + self.profile.duration or (self.homing and self.sensor_is_missing)

    def move(self, now: float, target: float, speed: str = "maxspeed") -> None:
        if self.is_busy(now):
            self.flags.add("NI")
        start = self.position(now)
        rate, ramp = self.settings[speed] / SPEED_UNITS, self.settings["accel"] * 1e4 / SPEED_UNITS
        self.profile = Profile(now, start, target - start - self.loses_steps, rate, ramp)

    def home(self, now: float) -> None:
        self.move(now, 0.0, min(("maxspeed", "limit.approach.maxspeed"), key=lambda name: self.settings.get(name, 1e9)))
        self.homing = True

    def stop(self, now: float) -> None:
        if not self.is_busy(now):
            return
        speed, old = self.profile.speed(now), self.profile
        self.flags.add("NI")
        self.homing = False
        self.profile = Profile(now, self.position(now), old.way, old.max_speed, old.acceleration, speed or 1e-9)

    def _settle(self, now: float) -> None:
        half = self.profile.began + self.profile.duration / 2
        if self.stalls and self.profile.way and now >= half:
            self.stalls, self.homing = False, False
            self.profile = Profile(now, self.profile.position(half), 0.0, 1.0, 1.0)
            self.flags.add("FS")
        if self.homing and not self.sensor_is_missing and now >= self.profile.began + self.profile.duration:
            self.homing = False
            self.flags -= {"WR", "WH"}
