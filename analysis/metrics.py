"""How far a result is from the truth, and how pictures compare."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def angular_error_deg(normals: Array, truth: Array) -> Array:
    """Return the angle between two fields of unit vectors in degrees, last axis dropped; NaN where either is.

    By the arctangent of cross over dot product, which keeps its digits at small angles where the
    arccosine loses them.
    """
    cross = np.linalg.norm(np.cross(normals, truth), axis=-1)
    return np.asarray(np.rad2deg(np.arctan2(cross, np.sum(normals * truth, axis=-1))))


def error_summary(error: Array) -> dict[str, float]:
    """Return mean, median and 95th percentile of the finite values (NaN if there are none)."""
    finite = error[np.isfinite(error)]
    if finite.size == 0:
        return {"mean": float("nan"), "median": float("nan"), "p95": float("nan")}
    return {
        "mean": float(finite.mean()),
        "median": float(np.median(finite)),
        "p95": float(np.percentile(finite, 95)),
    }


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
