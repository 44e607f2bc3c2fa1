"""Lets a light warm up until its drift is small."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from drivers.errors import DeviceError
from instrument.rig.rig import Rig
from protocols.acquisition.shot import light_on

SAMPLE_SECONDS = 2.0
"""Seconds from one reading of the light's monitor to the next."""

WINDOW = 5
"""Readings over which the slope is taken."""

PATIENCE = 2.0
"""How much longer than rated a light may take."""


@dataclass(frozen=True, slots=True)
class WarmUp:
    """How a light warmed up.

    Attributes
    ----------
    seconds : float
        How long it shone.
    slope : float
        Relative change per minute at the end; NaN if the light has no monitor.
    steady : bool
        Whether the slope got as small as the rig asks.
    """

    seconds: float
    slope: float
    steady: bool


def warm_up(rig: Rig, look: Callable[[], None]) -> WarmUp:
    """Shine until the monitor's slope is small, or for twice as long as ``light.warm_up_s``, the rated time.

    A light without a monitor shines for the rated time, which is all that is known of it.

    Parameters
    ----------
    rig : Rig
    look : callable
        Called at each reading; what it raises ends the warm-up, with the light off.

    Raises
    ------
    DeviceError
        If the light does not shine.
    CancelledError
        If somebody calls it off.
    """
    light, rated = rig.config.light, rig.config.light.warm_up_s
    readings, seconds, slope = list[float](), 0.0, math.nan
    with light_on(rig.light, light.level, SAMPLE_SECONDS + 1.0):
        while seconds < _longest(rated, readings) and not abs(slope) <= light.steady_per_minute:
            look()
            rig.wait(SAMPLE_SECONDS)
            seconds += SAMPLE_SECONDS
            # Told again each time: a program that dies leaves it lit for no longer than one reading.
            if not rig.light.on(light.level, SAMPLE_SECONDS + 1.0).lit:
                raise DeviceError("the light went dark while it warmed up. Check its supply")
            readings.append(rig.light.read().monitor)
            slope = slope_per_minute(readings)
    return WarmUp(seconds, slope, bool(abs(slope) <= light.steady_per_minute or math.isnan(readings[-1])))


def _longest(rated: float, readings: list[float]) -> float:
    has_monitor = bool(readings) and math.isfinite(readings[-1])
    return PATIENCE * rated if has_monitor else rated


def slope_per_minute(readings: list[float]) -> float:
    """Return the relative change per minute over the last readings; NaN while there are too few."""
    if len(readings) < WINDOW:
        return math.nan
    last = np.array(readings[-WINDOW:])
    slope = np.polyfit(np.arange(WINDOW) * SAMPLE_SECONDS / 60.0, last, 1)[0]
    return float(slope / last.mean())
