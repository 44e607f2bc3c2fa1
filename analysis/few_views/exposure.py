"""The power of each view where nobody stated it: found with all else, and foretold for a view that was not seen.

A telephone exposes each picture as it sees fit: a real card's pictures are up to 20 % off each other.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LIMIT = 0.5
"""Most by which a log power is moved from the stated one: half or once and a half as much again."""

_GAIN = 1.5  # of a step: what a view's power takes, normals and curves give back a third of

_LAW_SIGMA = np.array([0.7, 0.4])  # of the two slopes of the law

_LAW_SCATTER = 0.05  # of a log power about the law

_MIN_VIEWS = 4  # from which a law of two slopes is found


def stepped(log_power: Array, residual: list[Array]) -> Array:
    """Return the views' log powers after one step towards the median residuals; their mean stays.

    Parameters
    ----------
    log_power : ndarray, shape (N,)
        Against the stated powers.
    residual : list of N ndarray
        Log residuals of each view; of none, the power stays.
    """
    off = np.array([float(np.median(r)) if len(r) else 0.0 for r in residual])
    return np.asarray(np.clip(log_power + _GAIN * (off - off.mean()), -LIMIT, LIMIT))


def foretold(log_power: Array, distance: Array, brightness: Array, new_distance: Array, new_brightness: Array) -> Array:
    """Return the log powers of new views by the exposure law that the seen ones follow.

    log P = mean + b_1 (log d^2 - mean) + b_2 (log B - mean), by ridge regression: a camera that exposes by what it
    sees takes less light for a picture that is bright.

    Parameters
    ----------
    log_power, distance, brightness : ndarray, shape (N,)
        Of the views seen: against the stated powers; mm; mean of the picture predicted with equal powers.
    new_distance, new_brightness : ndarray, shape (M,)
    """
    if len(log_power) < _MIN_VIEWS:
        return np.full(len(new_distance), log_power.mean())

    def features(d: Array, B: Array) -> Array:
        return np.stack([2.0 * np.log(d), np.log(np.maximum(B, 1e-12))], axis=1)

    F = features(distance, brightness)
    centred = F - F.mean(axis=0)
    ridge = np.diag((_LAW_SCATTER / _LAW_SIGMA) ** 2)
    slope = np.linalg.solve(centred.T @ centred + ridge, centred.T @ (log_power - log_power.mean()))
    return np.asarray(log_power.mean() + (features(new_distance, new_brightness) - F.mean(axis=0)) @ slope)
