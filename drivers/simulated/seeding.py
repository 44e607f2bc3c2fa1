"""Random numbers that depend on what they are for, never on the order of the calls."""

from __future__ import annotations

from collections.abc import Mapping
from zlib import crc32

import numpy as np

_STEPS_PER_UNIT = 10_000
_WORD = 1 << 32


def rng_for(seed: int, purpose: str, *key: int) -> np.random.Generator:
    """Return the generator of one purpose, e.g. the noise of one frame.

    A capture that is interrupted and resumed thus sees the same numbers as one that was not.
    """
    return np.random.default_rng([seed, crc32(purpose.encode()), *(number % _WORD for number in key)])


def position_key(position: Mapping[str, float]) -> tuple[int, ...]:
    """Return integers that name a stage position, to 1e-4 of a degree or millimetre."""
    return tuple(round(position[axis] * _STEPS_PER_UNIT) for axis in sorted(position))
