"""Standard deviation of a depth that was integrated from normals."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from analysis.depth.integration import integrate_slopes

Array = NDArray[np.float64]

MAX_DRAWN = 192
"""Pixels along the longer side at which noise is drawn for `depth_sigma`."""


def depth_sigma(
    normal_sigma: Array,
    pitch: float,
    rng: np.random.Generator,
    n_draws: int = 32,
    *,
    weighted: bool = False,
) -> Array:
    """Propagate the normals' noise through the integration by drawing from it.

    Noise is taken as independent from pixel to pixel; a systematic error of the normals (a tilt, a bowl)
    is not in it. A large map is drawn in blocks of b x b pixels. Depth noise of slopes of variance v has in two
    dimensions the same variance, v pitch^2 / (2 pi), in every e-fold of wavelengths, and blocks keep v pitch^2:
    what they miss is ln(b) of these, which is added pixel by pixel.

    Parameters
    ----------
    normal_sigma : ndarray, shape (height, width)
        One standard deviation per tangent axis, rad; NaN = hole.
    pitch : float
        Millimetres.
    rng : numpy.random.Generator
    n_draws : int
        More draws make the map smoother: its own relative error is about 1 / sqrt(2 n_draws).
    weighted : bool
        Whether `normal_sigma` also weighs the integration, as `sigma` of `integrate_normals`.

    Returns
    -------
    ndarray, shape (height, width)
        One standard deviation of depth, mm; NaN in holes.
    """
    valid = np.isfinite(normal_sigma)
    if not valid.any():
        return np.full(normal_sigma.shape, np.nan)
    block = -(-max(normal_sigma.shape) // MAX_DRAWN)
    sigma = _sigma_of_block_means(normal_sigma, block)
    variance = _drawn_variance(sigma, block * pitch, rng, n_draws, weighted)
    if block > 1:
        variance = _refined(variance, block, normal_sigma.shape)
        variance += np.log(block) / (2.0 * np.pi) * (pitch * normal_sigma) ** 2
    return np.where(valid, np.sqrt(variance), np.nan)


def _drawn_variance(sigma: Array, pitch: float, rng: np.random.Generator, n_draws: int, weighted: bool) -> Array:
    valid, total = np.isfinite(sigma), np.zeros(sigma.shape)
    spread = np.where(valid, sigma, 0.0)
    for _ in range(n_draws):
        p, q = spread * rng.standard_normal((2, *sigma.shape))
        total += integrate_slopes(p, q, valid, pitch, 1e-3, sigma=sigma if weighted else None) ** 2
    return total / n_draws


def _sigma_of_block_means(sigma: Array, block: int) -> Array:
    """Return the sigma of the mean over each block's known pixels, NaN where there are none."""
    known = np.isfinite(sigma)
    edges = [np.arange(0, n, block) for n in sigma.shape]
    total, count = (
        np.add.reduceat(np.add.reduceat(a, edges[0], axis=0), edges[1], axis=1)
        for a in (np.where(known, sigma, 0.0) ** 2, known.astype(np.float64))
    )
    return np.where(count > 0.0, np.sqrt(total) / np.maximum(count, 1.0), np.nan)


def _refined(coarse: Array, block: int, shape: tuple[int, ...]) -> Array:
    """Interpolate values of blocks at the pixels; unknown blocks take the nearest known value."""
    nearest = ndimage.distance_transform_edt(np.isnan(coarse), return_distances=False, return_indices=True)
    rows, columns = ((np.arange(n) - 0.5 * (block - 1)) / block for n in shape)
    filled = coarse[tuple(nearest)]
    along = np.apply_along_axis(lambda a: np.interp(rows, np.arange(a.size), a), 0, filled)
    return np.asarray(np.apply_along_axis(lambda a: np.interp(columns, np.arange(a.size), a), 1, along))
