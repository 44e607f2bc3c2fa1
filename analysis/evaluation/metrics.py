"""How far a result is from the truth, and how pictures compare."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.results.summary import DepthShape, Quantiles

Array = NDArray[np.float64]


def angular_error_deg(normals: Array, truth: Array) -> Array:
    """Return the angle between two fields of unit vectors in degrees, last axis dropped; NaN where either is.

    By the arctangent of cross over dot product, which keeps its digits at small angles where the
    arccosine loses them.
    """
    cross = np.linalg.norm(np.cross(normals, truth), axis=-1)
    return np.asarray(np.rad2deg(np.arctan2(cross, np.sum(normals * truth, axis=-1))))


def error_summary(error: Array) -> Quantiles:
    """Return mean, median and 95th percentile of the finite values (NaN if there are none)."""
    finite = error[np.isfinite(error)]
    if finite.size == 0:
        return Quantiles(float("nan"), float("nan"), float("nan"))
    return Quantiles(float(finite.mean()), float(np.median(finite)), float(np.percentile(finite, 95)))


def depth_rmse(depth: Array, truth: Array) -> float:
    """Return the root mean square of the difference in mm, both freed of their mean over the common pixels."""
    difference = _common_difference(depth, truth)
    return float(np.sqrt(np.mean((difference - difference.mean()) ** 2))) if difference.size else float("nan")


def depth_rmse_without_plane(depth: Array, truth: Array) -> float:
    """Return the same with the best plane taken off the difference: relief without the gross tilt."""
    rows, columns = np.nonzero(np.isfinite(depth) & np.isfinite(truth))
    if rows.size < 3:
        return float("nan")
    A = np.stack([rows, columns, np.ones_like(rows)], axis=1).astype(np.float64)
    difference = _common_difference(depth, truth)
    residual = difference - A @ np.linalg.lstsq(A, difference, rcond=None)[0]
    return float(np.sqrt(np.mean(residual**2)))


def _common_difference(depth: Array, truth: Array) -> Array:
    common = np.isfinite(depth) & np.isfinite(truth)
    return np.asarray(depth[common] - truth[common])


def relative_rms(predicted: Array, measured: Array) -> float:
    """Return sqrt(sum (predicted - measured)^2 / sum measured^2) over the values that are finite in both."""
    common = np.isfinite(predicted) & np.isfinite(measured)
    power = float(np.sum(measured[common] ** 2))
    return float(np.sqrt(np.sum((predicted[common] - measured[common]) ** 2) / power)) if power > 0 else float("nan")


def psnr_db(predicted: Array, measured: Array, peak: float) -> float:
    """Return 20 log10(peak / RMS difference) over the values that are finite in both."""
    common = np.isfinite(predicted) & np.isfinite(measured)
    if not common.any():
        return float("nan")
    rms = float(np.sqrt(np.mean((predicted[common] - measured[common]) ** 2)))
    return float("inf") if rms == 0.0 else float(20.0 * np.log10(peak / rms))


def shape_terms(depth: Array, pitch: float) -> DepthShape:
    """Fit plane and bowl to `depth`, shape (height, width), mm, NaN = hole; `pitch` in mm.

    Terms that the known pixels do not determine (a tilt across a single row) are 0; without any all are NaN.
    """
    rows, columns = np.nonzero(np.isfinite(depth))
    if rows.size == 0:
        return DepthShape(*[float("nan")] * 7)
    height, width = depth.shape
    z = depth[rows, columns]
    # In units of the longer side, so that the columns are of one size and the rank can be told.
    side = max(height, width)
    unit = pitch * side
    x = (columns - 0.5 * (width - 1)) / side
    y = (0.5 * (height - 1) - rows) / side
    r_squared = x * x + y * y
    A = np.stack([np.ones_like(x), x, y, 0.5 * r_squared])
    flat, plane, bowl = (_fit(A[:n], z) for n in (1, 3, 4))
    return DepthShape(
        tilt_x=float(plane[1] / unit),
        tilt_y=float(plane[2] / unit),
        bowl=float(bowl[3] / unit**2),
        sag=float(0.5 * bowl[3] * r_squared.max()),
        rms=_rms(z - flat @ A[:1]),
        rms_without_plane=_rms(z - plane @ A[:3]),
        rms_without_bowl=_rms(z - bowl @ A),
    )


def _fit(A: Array, z: Array) -> Array:
    """Return the shortest of the least-squares solutions, from the moments."""
    return np.asarray(np.linalg.pinv(A @ A.T, rcond=1e-10, hermitian=True) @ (A @ z))


def _rms(residual: Array) -> float:
    return float(np.sqrt(np.mean(residual**2)))
