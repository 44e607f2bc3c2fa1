"""Depth from normals: the least-squares surface whose slopes are the measured ones.

With slopes p = -n_x / n_z = dz/dx and q = -n_y / n_z = dz/dy, z minimises over all pairs of neighbours

    sum w (z_b - z_a - g)^2 ,    g = pitch ((s_a + s_b) / 2 - (c_a + c_b) / 24) ,

s being the slope along the pair and c its second difference about a pixel: the integral over the pair of the
cubic through four slopes (of the parabola through three where only one end knows its c, else the trapezoid).

On a full rectangle with equal weights the normal equations are a Poisson equation with Neumann borders, which
the cosine transform makes diagonal [frankot1988, simchony1990]. Holes and weights are left to
`analysis.depth.multigrid`.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.fft import dctn, idctn

from analysis.compiling import njit
from analysis.depth.multigrid import PairSystem

Array = NDArray[np.float64]

Mask = NDArray[np.bool_]

MAX_SLOPE = 5.0
"""Steeper than 79 deg a normal says nothing about depth: the pixel counts as a hole."""

SIGMA_FLOOR, SIGMA_CAP = 0.2, 100.0
"""Sigmas are clipped to these multiples of their median, so weights span at most 2.5e5.

Below a fifth of the median the systematic errors, which no stated sigma holds, are what counts; and a weight of
1e-4 already keeps a wrong normal from bending its neighbours."""

UNSTATED_SIGMA = 0.01
"""Of a normal, rad, where no sigma is given."""

TRUSTED_RATIO = 3.0
"""A slope less certain than this, relative to the pair's own, has no say in the pair's curvature term."""

THREADS = 2
"""Of the cosine transform; more gain little, since memory limits it."""


def integrate_normals(
    normals: Array,
    pitch: float,
    tolerance: float = 1e-6,
    *,
    sigma: Array | None = None,
) -> Array:
    """Integrate a normal map.

    Parameters
    ----------
    normals : ndarray, shape (height, width, 3)
        Unit vectors, x right, y up, z out of the sample; NaN = hole.
    pitch : float
        Size of a pixel, mm.
    tolerance : float
        Of the iteration's residual; unused by the direct solution (no hole, no sigma).
    sigma : ndarray, shape (height, width), or None
        One standard deviation of a normal per tangent axis, rad; NaN = hole. A pair weighs as the inverse
        variance of its slope, within the range of `SIGMA_FLOOR` and `SIGMA_CAP`. None = all weigh the same.

    Returns
    -------
    ndarray, shape (height, width)
        Depth in mm, NaN in holes. Parts that holes cut off from each other have no height against each
        other: each has mean 0.

    Raises
    ------
    ValueError
        If `sigma` has another shape than the map.
    """
    p, q, valid = slopes_from_normals(normals)
    return integrate_slopes(p, q, valid, pitch, tolerance, sigma=sigma)


def slopes_from_normals(normals: Array) -> tuple[Array, Array, Mask]:
    """Return dz/dx, dz/dy (0 in holes) and where they are known."""
    shape = normals.shape[:2]
    p, q, valid = np.empty(shape), np.empty(shape), np.empty(shape, np.bool_)
    _slopes(np.ascontiguousarray(normals, np.float64), p, q, valid)
    return p, q, valid


@njit(cache=True, nogil=True)
def _slopes(normals: Array, p: Array, q: Array, valid: Mask) -> None:
    for i in range(p.shape[0]):
        for j in range(p.shape[1]):
            n_x, n_y, n_z = normals[i, j, 0], normals[i, j, 1], normals[i, j, 2]
            # NaN fails every comparison.
            known = n_z > 0.0 and abs(n_x) <= MAX_SLOPE * n_z and abs(n_y) <= MAX_SLOPE * n_z
            valid[i, j] = known
            p[i, j] = -n_x / n_z if known else 0.0
            q[i, j] = -n_y / n_z if known else 0.0


def integrate_slopes(
    p: Array,
    q: Array,
    valid: Mask,
    pitch: float,
    tolerance: float = 1e-6,
    *,
    sigma: Array | None = None,
) -> Array:
    """Integrate slopes dz/dx (`p`) and dz/dy (`q`), each of shape (height, width), known where `valid`.

    The rest is as in `integrate_normals`.
    """
    if sigma is not None and sigma.shape != p.shape:
        raise ValueError(f"sigma has shape {sigma.shape}; the map has {p.shape}. Give one value for each pixel.")
    if sigma is not None:
        valid = valid & np.isfinite(sigma)
    if not valid.any():
        return np.full(p.shape, np.nan)
    if sigma is None and valid.all():
        return _solve_poisson(_full_right_side(p, q, pitch))
    v_p, v_q = _slope_variances(p, q, valid, sigma)
    # A pair weighs as though its noise were its own. It shares each slope with the next pair, so that is the
    # variance which makes a long path as uncertain as it is: a slope's for each pair, not half of it.
    g_x, w_x = _pairs(p, v_p, pitch, along_rows=True)
    g_y, w_y = _pairs(q, v_q, pitch, along_rows=False)
    system = PairSystem(w_x, w_y)
    return _with_means_removed(system.solve(system.right_side(g_x, g_y), tolerance), valid)


def _slope_variances(p: Array, q: Array, valid: Mask, sigma: Array | None) -> tuple[Array, Array]:
    """Return the variances of p and q, NaN in holes.

    With J the derivative of p = -n_x / n_z at a unit normal, J J^T = (1 + p^2 + q^2) (1 + p^2).
    """
    if sigma is None:
        uniform = np.where(valid, UNSTATED_SIGMA**2, np.nan)
        return uniform, uniform
    middle = float(np.median(sigma[valid])) or 1.0
    variance = np.where(valid, np.clip(sigma, SIGMA_FLOOR * middle, SIGMA_CAP * middle) ** 2, np.nan)
    steepness = 1.0 + p * p + q * q
    return variance * steepness * (1.0 + p * p), variance * steepness * (1.0 + q * q)


def _pairs(s: Array, variance: Array, pitch: float, along_rows: bool) -> tuple[Array, Array]:
    """Return increments and weights (1 / mm^2) of all pairs, each of shape (height, width)."""
    g, w = np.zeros_like(s), np.zeros_like(s)
    # y grows upwards, rows downwards.
    if along_rows:
        _weigh_pairs(s, variance, pitch, 0, 1, g, w)
    else:
        _weigh_pairs(s, variance, -pitch, 1, 0, g, w)
    return g, w


@njit(cache=True, nogil=True)
def _mean_slope(a: float, b: float, c: float, n_c: int) -> float:
    """Return the mean slope over a pair; `c` is the sum of the `n_c` second differences that are known."""
    return 0.5 * (a + b) - c / (12.0 * max(n_c, 1))


@njit(cache=True, nogil=True)
def _weigh_pairs(s: Array, variance: Array, step: float, di: int, dj: int, g: Array, w: Array) -> None:
    # Scalars only go into helpers: an array would be reference-counted at every pixel, six times the time.
    height, width = s.shape
    for i in range(height - di):
        for j in range(width - dj):
            a, b = s[i, j], s[i + di, j + dj]
            v_a, v_b = variance[i, j], variance[i + di, j + dj]
            if not v_a + v_b > 0.0:  # a NaN: one of them is a hole
                continue
            trusted = TRUSTED_RATIO**2 * max(v_a, v_b)
            c, n_c = 0.0, 0
            if i >= di and j >= dj and variance[i - di, j - dj] <= trusted:
                c, n_c = c + s[i - di, j - dj] - 2.0 * a + b, n_c + 1
            if i + 2 * di < height and j + 2 * dj < width and variance[i + 2 * di, j + 2 * dj] <= trusted:
                c, n_c = c + a - 2.0 * b + s[i + 2 * di, j + 2 * dj], n_c + 1
            g[i, j] = step * _mean_slope(a, b, c, n_c)
            w[i, j] = 2.0 / (step * step * (v_a + v_b))


def _full_right_side(p: Array, q: Array, pitch: float) -> Array:
    """Return D^T g where no pixel is missing and all weigh the same."""
    total = np.zeros(p.shape)
    _add_full(p, pitch, 0, 1, total)
    _add_full(q, -pitch, 1, 0, total)
    return total


@njit(cache=True, nogil=True)
def _add_full(s: Array, step: float, di: int, dj: int, total: Array) -> None:
    height, width = s.shape
    for i in range(height - di):
        for j in range(width - dj):
            a, b = s[i, j], s[i + di, j + dj]
            c, n_c = 0.0, 0
            if i >= di and j >= dj:
                c, n_c = c + s[i - di, j - dj] - 2.0 * a + b, n_c + 1
            if i + 2 * di < height and j + 2 * dj < width:
                c, n_c = c + a - 2.0 * b + s[i + 2 * di, j + 2 * dj], n_c + 1
            g = step * _mean_slope(a, b, c, n_c)
            total[i, j] -= g
            total[i + di, j + dj] += g


def _solve_poisson(right_side: Array) -> Array:
    spectrum = dctn(right_side, norm="ortho", workers=THREADS, overwrite_x=True)
    rows, columns = (2.0 - 2.0 * np.cos(np.pi * np.arange(n) / n) for n in right_side.shape)
    spectrum[0, 1:] /= columns[1:]  # the mean, at [0, 0], is free
    spectrum[1:] /= rows[1:, None] + columns[None, :]
    spectrum[0, 0] = 0.0
    return np.asarray(idctn(spectrum, norm="ortho", workers=THREADS, overwrite_x=True))


def _with_means_removed(z: Array, valid: Mask) -> Array:
    """Give each connected part the mean 0, and holes NaN."""
    parts, n_parts = ndimage.label(valid)
    means = np.bincount(parts.ravel(), z.ravel(), n_parts + 1) / np.maximum(np.bincount(parts.ravel()), 1)
    return np.where(valid, z - means[parts], np.nan)
