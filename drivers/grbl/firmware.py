"""What the firmware is set to, and whether the stage of rig.toml can live with it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from math import isclose

from drivers.errors import DeviceError
from drivers.grbl.settings import GrblAxis, GrblSettings
from drivers.readback import Setting

_SETTING = re.compile(r"\$(\d{1,3})=(-?\d+(?:\.\d+)?)")
_VERSION = re.compile(r"\[VER:([^:\]]*):?([^\]]*)\]")
_OPTIONS = re.compile(r"\[OPT:([^,\]]*)[^\]]*\]")

_REPORTS_IN_INCHES, _SOFT_LIMITS, _HOMING, _HOMING_DIRECTIONS = 13, 20, 22, 23
_HOMING_FEED, _HOMING_SEEK, _HOMING_PULL_OFF = 24, 25, 27
_STEPS, _MAX_RATE, _ACCELERATION, _TRAVEL = 100, 110, 120, 130

_N_HOMING_CYCLES = 3  # of axes that are homed one after the other, at most
_SEARCH, _LOCATE = 1.5, 5.0  # of the travel and of the pull-off, after the firmware's documentation


@dataclass(frozen=True, slots=True)
class Firmware:
    """Settings and build of a controller.

    Attributes
    ----------
    values : mapping of int to float
        By number, as ``$$`` prints them.
    build : str
        Version and date.
    label : str
        What the operator wrote there with ``$I=``; empty if nothing.
    options : str
        Letters of what was compiled in.
    """

    values: Mapping[int, float]
    build: str
    label: str
    options: str

    @classmethod
    def from_lines(cls, settings: Iterable[str], build: Iterable[str]) -> Firmware:
        """Return the firmware that answered so to ``$$`` and ``$I``."""
        found = [match for match in map(_SETTING.fullmatch, settings) if match]
        values = {int(match[1]): float(match[2]) for match in found}
        text = "\n".join(build)
        version, options = _VERSION.search(text), _OPTIONS.search(text)
        name, label = (version[1], version[2]) if version else ("", "")
        return cls(values, name, label, options[1] if options else "")

    def max_rate(self, axis: GrblAxis) -> float:
        """Return the fastest speed in the firmware's units per second."""
        return self.values[_MAX_RATE + axis.i_letter] / 60.0

    def acceleration(self, axis: GrblAxis) -> float:
        """Return the acceleration in the firmware's units per second squared."""
        return self.values[_ACCELERATION + axis.i_letter]

    def travel(self, axis: GrblAxis) -> tuple[float, float]:
        """Return the lowest and highest machine position that the firmware's soft limits let pass."""
        length = self.values[_TRAVEL + axis.i_letter]
        upwards = int(self.values.get(_HOMING_DIRECTIONS, 0.0)) >> axis.i_letter & 1
        # Built with Z, homing sets the origin at the switch, and the travel may be on its positive side.
        return (0.0, length) if "Z" in self.options and upwards else (-length, 0.0)

    def homing_limit(self, axes: Sequence[GrblAxis]) -> float:
        """Return the seconds in which homing ends, one way or the other."""
        travel = max(self.values[_TRAVEL + axis.i_letter] for axis in axes)
        pull_off = self.values[_HOMING_PULL_OFF]
        search = (_SEARCH * travel + 2.0 * pull_off) / self.values[_HOMING_SEEK]
        locate = _LOCATE * pull_off / self.values[_HOMING_FEED]
        return 10.0 + 60.0 * _N_HOMING_CYCLES * (search + locate)

    def stopping_time(self, axes: Sequence[GrblAxis]) -> float:
        """Return the seconds from full speed to rest."""
        return max(self.max_rate(axis) / self.acceleration(axis) for axis in axes)

    def read_back(self, axes: Iterable[GrblAxis]) -> Iterator[Setting]:
        """Yield how fast each axis may go, in degrees or millimetres."""
        for axis in axes:
            unit = axis.describe().soft_limits.unit
            steps = self.values[_STEPS + axis.i_letter] * abs(axis.scale)
            yield Setting(f"steps of axis {axis.name}", steps, f"1/{unit}")
            yield Setting(f"speed of axis {axis.name}", self.max_rate(axis) / abs(axis.scale), f"{unit}/s")
            yield Setting(f"acceleration of axis {axis.name}", self.acceleration(axis) / abs(axis.scale), f"{unit}/s^2")

    def check(self, settings: GrblSettings) -> None:
        """Refuse a controller that is not set up for the stage.

        Raises
        ------
        DeviceError
            With all that does not fit, and what to set.
        """
        problems = list(self._missing(settings)) or [
            *self._wrong(settings),
            *(text for axis in settings.axes for text in self._misfits(axis)),
        ]
        if problems:
            raise DeviceError(f"the controller at {settings.port} does not fit rig.toml: {'; '.join(problems)}.")

    def _missing(self, settings: GrblSettings) -> Iterator[str]:
        shared = (_REPORTS_IN_INCHES, _SOFT_LIMITS, _HOMING, _HOMING_FEED, _HOMING_SEEK, _HOMING_PULL_OFF)
        absent = [number for number in shared if number not in self.values]
        if absent:
            yield f"it did not tell {_dollars(absent)}; look at the cable, and whether it is GRBL 1.1"
        for axis in settings.axes:
            own = [kind + axis.i_letter for kind in (_STEPS, _MAX_RATE, _ACCELERATION, _TRAVEL)]
            absent = [number for number in own if number not in self.values]
            if absent:
                yield f"it has no axis {axis.letter} ({_dollars(absent)}); correct the letter of axis {axis.name}"

    def _wrong(self, settings: GrblSettings) -> Iterator[str]:
        if self.values[_REPORTS_IN_INCHES]:
            yield "it reports in inches; set $13=0"
        # The lowest bit; grblHAL keeps more in the others.
        homing = int(self.values[_HOMING]) & 1
        if settings.homing and not homing:
            yield "homing is off; set $22=1, or homing = false where there are no limit switches"
        if not settings.homing and homing:
            yield "it wants to be homed; set homing = true, or $22=0 where there are no limit switches"
        rates = (_HOMING_FEED, _HOMING_SEEK) if settings.homing else ()
        yield from (
            f"${number} is {self.values[number]:g}; it must be above 0" for number in rates if not self._up(number)
        )

    def _misfits(self, axis: GrblAxis) -> Iterator[str]:
        numbers = [kind + axis.i_letter for kind in (_STEPS, _MAX_RATE, _ACCELERATION)]
        bad = [number for number in numbers if not self._up(number)]
        if bad:
            yield f"axis {axis.name}: {_dollars(bad)} must be above 0"
            return
        steps, stated = self.values[numbers[0]], axis.steps_per_unit
        if stated is not None and not isclose(stated, steps, rel_tol=1e-3):
            yield (
                f"axis {axis.name}: ${numbers[0]} is {steps:g}, rig.toml has {stated:g} as steps_per_unit; if the "
                f"controller has lost its settings, set ${numbers[0]}={stated:g} and look at all others too"
            )
        # Half a step, and half of the last decimal of a report.
        finest = (0.5 / self.values[_STEPS + axis.i_letter] + 0.0005) / abs(axis.scale)
        if axis.tolerance < finest:
            yield f"axis {axis.name}: tolerance {axis.tolerance:g} is finer than a step; allowed from {finest:.3g}"
        yield from self._beyond_travel(axis)

    def _beyond_travel(self, axis: GrblAxis) -> Iterator[str]:
        low, high = self.travel(axis)
        ends = [axis.machine_from_position(end) for end in axis.soft_limits]
        # A travel of 0 is that of an axis without ends.
        if self.values[_SOFT_LIMITS] and low < high and not (low <= min(ends) and max(ends) <= high):
            yield (
                f"axis {axis.name}: soft_limits are {min(ends):g} to {max(ends):g} in its units and the firmware's "
                f"($20, ${_TRAVEL + axis.i_letter}) are {low:g} to {high:g}; correct zero, scale or soft_limits"
            )

    def _up(self, number: int) -> bool:
        return self.values[number] > 0.0


def _dollars(numbers: Iterable[int]) -> str:
    return ", ".join(f"${number}" for number in numbers)
