"""Residuals of corners as arrows over the picture: how many times as long, and what they have in common."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

REGIONS = (8, 6)
"""Across and down the picture."""

_ENOUGH = 10  # corners that a region needs

_SHARE = 0.04  # of the picture's width that a long arrow takes


def exaggeration(residuals: Array, image_size: tuple[int, int], share: float = _SHARE) -> float:
    """Return a round number of times that makes long arrows at most `share` of the picture's width."""
    if not len(residuals):
        return 1.0
    long = float(np.percentile(np.linalg.norm(residuals, axis=1), 95))
    return rounded_down(share * image_size[0] / max(long, 1e-9))


def rounded_down(value: float) -> float:
    """Return the largest 1, 2 or 5 times a power of ten that a positive number holds."""
    power = 10.0 ** np.floor(np.log10(value))
    return float(power * max(step for step in (1.0, 2.0, 5.0) if step * power <= value))


def by_region(points: Array, residuals: Array, image_size: tuple[int, int]) -> tuple[Array, Array, Array]:
    """Return centres (n, 2), mean residuals (n, 2) and their standard errors (n,) of regions with enough corners."""
    size = np.array(image_size) / REGIONS
    index = np.clip((points + 0.5) // size, 0, np.array(REGIONS) - 1).astype(int)
    which = index[:, 1] * REGIONS[0] + index[:, 0]
    enough = np.flatnonzero(np.bincount(which) >= _ENOUGH)
    means = np.array([residuals[which == k].mean(axis=0) for k in enough]).reshape(-1, 2)
    errors = [np.sqrt(np.sum(residuals[which == k].var(axis=0)) / np.sum(which == k)) for k in enough]
    centres = (np.stack([enough % REGIONS[0], enough // REGIONS[0]], axis=1) + 0.5) * size - 0.5
    return centres, means, np.maximum(errors, 1e-12)
