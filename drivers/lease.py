"""What every light checks before it shines."""

from __future__ import annotations

import math

from drivers.errors import DeviceLimitError
from drivers.limits import Limits

LEVEL_LIMITS = Limits(0.0, 1.0, "of full level")

LONGEST_LEASE = 300.0
"""Seconds that a real light may be told to shine at a time, unless the rig file says otherwise."""


def check_level(level: float, limits: Limits = LEVEL_LIMITS) -> None:
    """Raise unless a light may shine at `level`.

    Raises
    ------
    DeviceLimitError
        With what is allowed.
    """
    limits.check("level", level, "Set light.level in the rig file within them.")


def check_lease(max_seconds: float, longest: float = math.inf) -> None:
    """Raise unless a light may be told to shine for `max_seconds`.

    Parameters
    ----------
    max_seconds : float
        The lease in seconds.
    longest : float
        Longest that the light allows; infinite = any that ends.

    Raises
    ------
    DeviceLimitError
        If it never begins, never ends or is too long.
    """
    if not (max_seconds > 0.0 and math.isfinite(max_seconds)):
        raise DeviceLimitError(
            f"max_seconds is {max_seconds:g} s; allowed is more than 0 s, and finite. "
            "Ask for as long as the frames of one pose take."
        )
    if max_seconds > longest:
        raise DeviceLimitError(
            f"max_seconds is {max_seconds:g} s; allowed is up to {longest:g} s. "
            "Shorten the bracket, or set longest_lease_s in the rig file's [light.device]."
        )
