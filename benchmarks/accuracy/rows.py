"""A row of the benchmark: how far an estimate is from the truth, how sure it says it is, how fast it came."""

from __future__ import annotations

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from analysis.evaluation.metrics import angular_error_deg, depth_rmse, depth_rmse_without_plane
from benchmarks.common.methods import Estimate
from benchmarks.common.scenes import Scene

Array = NDArray[np.float64]

Row: TypeAlias = dict[str, Any]

KEYS = (
    "scene",
    "method",
    "n_views",
    "noise",
    "mean_deg",
    "median_deg",
    "p95_deg",
    "share_above_5deg",
    "pixels_per_s",
    "ratio_to_reference",
    "coverage68",
    "coverage95",
    "curve_error",
    "n_pixels",
    "seed",
)
"""What every row has; null where it cannot be told."""

INSIDE_68, INSIDE_95 = 1.5096, 2.4477
"""Sigmas per axis within which 68 % and 95 % of a two-dimensional Gaussian lie."""

FAR_OFF_DEG = 5.0

N_ANGLES = 12

MAX_HALF_ANGLE = float(np.deg2rad(80.0))
"""Beyond it no curve is judged: the samples there are nearly dark."""

_RESAMPLINGS = 100  # for the standard error of a median


def score(scene: Scene, estimate: Estimate) -> Row:
    """Return the figures of an estimate that need nothing but the scene."""
    error = angular_error_deg(estimate.normals, scene.normals)
    row: Row = {**error_figures(error), **coverage(error, estimate.sigma)}
    row["curve_error"] = curve_error(scene, estimate)
    row["n_pixels"] = len(error)
    row["pixels_per_s"] = len(error) / estimate.seconds if estimate.seconds > 0.0 else np.nan
    row["seconds"], row["cpu_seconds"] = estimate.seconds, estimate.cpu_seconds
    truth = scene.stack.truth
    if estimate.depth is not None and truth is not None and np.isfinite(truth.depth).any():
        row["depth_rmse_mm"] = depth_rmse(estimate.depth, truth.depth)
        row["depth_rmse_without_plane_mm"] = depth_rmse_without_plane(estimate.depth, truth.depth)
    return row | estimate.notes


def error_figures(error: Array) -> Row:
    """Return mean, median, 95th percentile and the share far off, of errors in degrees; NaN = not solved.

    Pixels that were not solved count as far off and for nothing else. The standard errors take pixels for independent.
    """
    finite = error[np.isfinite(error)]
    share = float(np.mean(~(error <= FAR_OFF_DEG)))
    row: Row = {"share_above_5deg": share, "share_se": float(np.sqrt(share * (1.0 - share) / len(error)))}
    row["n_unsolved"] = len(error) - len(finite)
    if finite.size == 0:
        return row | dict.fromkeys(("mean_deg", "median_deg", "p95_deg", "mean_se_deg", "median_se_deg"), np.nan)
    rng = np.random.default_rng(0)
    medians = [np.median(rng.choice(finite, finite.size)) for _ in range(_RESAMPLINGS)]
    return row | {
        "mean_deg": float(finite.mean()),
        "median_deg": float(np.median(finite)),
        "p95_deg": float(np.percentile(finite, 95)),
        "mean_se_deg": float(finite.std() / np.sqrt(finite.size)),
        "median_se_deg": float(np.std(medians)),
    }


def coverage(error: Array, sigma: Array) -> Row:
    """Return how many of the true normals the stated 68 and 95 % intervals hold, of errors in degrees.

    Parameters
    ----------
    error : ndarray, shape (P,)
        Degrees.
    sigma : ndarray, shape (P,)
        Stated standard deviation per tangent axis, rad; NaN = none stated.
    """
    stated = np.isfinite(error) & np.isfinite(sigma)
    if not stated.any():
        return {"coverage68": np.nan, "coverage95": np.nan}
    error, sigma = error[stated], np.rad2deg(sigma[stated])
    return {
        "coverage68": float(np.mean(error < INSIDE_68 * sigma)),
        "coverage95": float(np.mean(error < INSIDE_95 * sigma)),
    }


def curve_error(scene: Scene, estimate: Estimate) -> float:
    """Return the median over pixels of the RMS of fitted over true curve less 1, over the half angles seen."""
    theta_h = seen_half_angles(scene)
    truth = scene.curve(theta_h)
    ratio = np.where(truth > 0.0, estimate.curve(theta_h) / np.where(truth > 0.0, truth, 1.0), np.nan)
    rms = np.sqrt(np.nanmean((ratio - 1.0) ** 2, axis=(1, 2)))
    rms = rms[np.isfinite(rms) & np.isfinite(estimate.normals[:, 0])]
    return float(np.median(rms)) if rms.size else float("nan")


def seen_half_angles(scene: Scene) -> Array:
    """Return `N_ANGLES` half angles from the smallest to the largest that the views show, shape (P, N_ANGLES), rad."""
    stack, normals = scene.stack, scene.normals
    points = stack.grid.points().reshape(-1, 3)
    low, high = np.full(len(points), np.pi / 2), np.zeros(len(points))
    for camera, light in zip(stack.camera_position, stack.light_position, strict=True):
        to_light, to_camera = (d / np.linalg.norm(d, axis=1, keepdims=True) for d in (light - points, camera - points))
        h = to_light + to_camera
        cosine = np.sum(normals * h, axis=1) / np.linalg.norm(h, axis=1)
        theta = np.arccos(np.clip(cosine, -1.0, 1.0))
        seen = (theta < MAX_HALF_ANGLE) & (np.sum(normals * to_light, axis=1) > 0.0)
        low, high = np.where(seen, np.minimum(low, theta), low), np.where(seen, np.maximum(high, theta), high)
    low = np.minimum(low, high)
    return np.asarray(low[:, None] + (high - low)[:, None] * np.linspace(0.0, 1.0, N_ANGLES))


def paired(error: Array, reference_error: Array) -> Row:
    """Return how a method does on the very pixels of the reference, errors in degrees of the same pixels."""
    both = np.isfinite(error) & np.isfinite(reference_error)
    if not both.any():
        return {}
    ours, theirs = error[both], reference_error[both]
    return {
        "paired_n_pixels": int(both.sum()),
        "paired_mean_deg": float(ours.mean()),
        "paired_median_deg": float(np.median(ours)),
        "paired_reference_mean_deg": float(theirs.mean()),
        "paired_reference_median_deg": float(np.median(theirs)),
        "paired_better_than_reference": float(np.mean(ours < theirs)),
    }
