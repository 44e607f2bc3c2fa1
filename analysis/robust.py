"""Robust statistics: scales and weights that a few wrong samples do not move."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

MAD_TO_SIGMA = 1.4826
"""Standard deviation of a Gaussian over its median absolute deviation, 1 / Phi^-1(3/4)."""


def mad_sigma(residual: Array, floor: float = 0.0) -> float:
    """Return the standard deviation that the median of |residual| stands for, at least `floor`.

    Parameters
    ----------
    residual : ndarray
        About 0, any shape.
    floor : float
        In the units of the residual.
    """
    return max(MAD_TO_SIGMA * float(np.median(np.abs(residual))), floor)


def huber_weights(residual: Array, limit: float) -> Array:
    """Return Huber's weights [huber1964], shape of `residual`: 1 within `limit`, limit / |residual| beyond.

    Parameters
    ----------
    residual : ndarray
    limit : float
        In the units of the residual, positive.
    """
    return 1.0 / np.maximum(np.abs(residual) / limit, 1.0)


def tukey_weights(residual: Array, limit: float) -> Array:
    """Return Tukey's biweight [beaton1974], shape of `residual`: (1 - (r / limit)^2)^2 within `limit`, 0 beyond.

    Parameters
    ----------
    residual : ndarray
    limit : float
        In the units of the residual, positive.
    """
    return np.maximum(1.0 - (residual / limit) ** 2, 0.0) ** 2


def sandwich(inverse: Array, pull: Array) -> Array:
    """Return the covariance of estimates whose samples are not independent [huber1967].

    With H^-1 the inverse of the normal matrix and g_b the gradient that block b of samples adds to the loss at its
    minimum, the covariance is H^-1 (sum_b g_b g_b^T) H^-1: the scatter of whole blocks counts, not that of samples.

    Parameters
    ----------
    inverse : ndarray, shape (n, n)
        H^-1.
    pull : ndarray, shape (n_blocks, n)
        g_b.
    """
    return np.asarray(inverse @ (pull.T @ pull) @ inverse)
