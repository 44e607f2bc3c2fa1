"""How long a straight motion takes that starts and ends at rest."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class AxisMotion:
    """What one axis does in a motion.

    Attributes
    ----------
    way : float
        In the firmware's units.
    max_rate : float
        Units per second.
    acceleration : float
        Units per second squared.
    """

    way: float
    max_rate: float
    acceleration: float


def fastest_rate(motions: Sequence[AxisMotion]) -> float:
    """Return the speed along the way, units per second, at which the first axis is at its fastest; 0 = no way."""
    return _along(motions, [motion.max_rate for motion in motions])


def duration(motions: Sequence[AxisMotion]) -> float:
    """Return the seconds that all axes take together, speed being a trapezoid or a triangle over time."""
    length = _length(motions)
    if length == 0.0:
        return 0.0
    rate = fastest_rate(motions)
    acceleration = _along(motions, [motion.acceleration for motion in motions])
    if length < rate**2 / acceleration:
        return 2.0 * math.sqrt(length / acceleration)
    return length / rate + rate / acceleration


def _along(motions: Sequence[AxisMotion], bounds: Sequence[float]) -> float:
    length = _length(motions)
    shares = [bound * length / abs(m.way) for m, bound in zip(motions, bounds, strict=True) if m.way != 0.0]
    return min(shares, default=0.0)


def _length(motions: Sequence[AxisMotion]) -> float:
    return math.hypot(*(motion.way for motion in motions))
