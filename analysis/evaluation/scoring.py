"""Figures of a reconstruction: against the truth where there is one, and on views held out of the fit."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.evaluation.held_out import glossy_pixels, hold_out
from analysis.evaluation.metrics import (
    angular_error_deg,
    depth_rmse,
    depth_rmse_without_plane,
    error_summary,
    shape_terms,
)
from analysis.pixels.problem import sample_pixels
from analysis.reconstruction.reconstruction import Reconstruction
from analysis.registration.lighting import camera_moves, theta_d_deg
from analysis.registration.stack import Truth
from analysis.results.summary import Summary
from analysis.stages import Track, untracked

Array = NDArray[np.float64]


def truth_error(reconstruction: Reconstruction) -> Array | None:
    """Return the angular error of each pixel in degrees, shape (H, W), or None without a truth."""
    truth = reconstruction.stack.truth
    return None if truth is None else angular_error_deg(reconstruction.normals, truth.normals)


def score(
    reconstruction: Reconstruction, n_held_out: int = 6, n_pixels: int = 2000, track: Track = untracked
) -> Summary:
    """Return the figures that a report and a program want.

    Parameters
    ----------
    reconstruction : Reconstruction
    n_held_out : int
        Views that are held out in turn, spread evenly over the capture; 0 = none.
    n_pixels : int
        Pixels on which they are predicted, drawn with a fixed seed.
    track : Track
        Learns how many of these views are done.
    """
    stack, fits, depth = reconstruction.stack, reconstruction.fits, reconstruction.depth
    offset, budget = reconstruction.light_offset, reconstruction.budget
    solved, theta_d = np.isfinite(fits.normals[:, 0]), theta_d_deg(stack)
    pixels = sample_pixels(stack, n_pixels, np.random.default_rng(0))
    summary = Summary(
        n_views=stack.n_views,
        n_pixels=int(solved.size),
        n_unsolved=int(np.count_nonzero(~solved)),
        pixel_pitch_mm=stack.pixel_pitch,
        share_glossy=float(glossy_pixels(fits)[solved].mean()) if solved.any() else float("nan"),
        theta_h_range_deg=_theta_h_range(reconstruction),
        theta_d_deg=(float(np.median(theta_d)), float(theta_d.max())),
        camera_moves=camera_moves(stack),
        normal_sigma_deg=error_summary(np.rad2deg(fits.normal_sigma)),
        reduced_chi2=error_summary(fits.reduced_chi2),
        relative_error=reconstruction.noise.relative,
        depth_shape=shape_terms(depth, stack.pixel_pitch) if np.isfinite(depth).sum() > 5 else None,
        n_materials=_n_materials(reconstruction),
        light_offset_mm=None if offset is None else _three(offset.value),
        light_offset_sigma_mm=None if offset is None else _three(offset.sigma),
        error_budget_deg=None if budget is None else budget.contributions,
        left_out=hold_out(reconstruction, _spread(stack.n_views, n_held_out), pixels, track),
    )
    return summary if stack.truth is None else replace(summary, **_against_truth(reconstruction, stack.truth))


def _n_materials(reconstruction: Reconstruction) -> int | None:
    if reconstruction.few_views is not None:
        return reconstruction.few_views.state.n_materials
    return None if reconstruction.palette is None else reconstruction.palette.found.palette.n_materials


def _against_truth(reconstruction: Reconstruction, truth: Truth) -> dict[str, Any]:
    """Return the figures of `Summary` that only a truth can tell."""
    error = angular_error_deg(reconstruction.normals, truth.normals)
    # Of a two-dimensional Gaussian error with sigma per axis, 68 % lie within 1.51 sigma, 95 % within 2.45.
    ratio = error.ravel() / np.rad2deg(reconstruction.fits.normal_sigma)
    ratio = ratio[np.isfinite(ratio)]
    return {
        "normal_error_deg": error_summary(error),
        "depth_rmse_mm": depth_rmse(reconstruction.depth, truth.depth),
        "depth_rmse_without_plane_mm": depth_rmse_without_plane(reconstruction.depth, truth.depth),
        "coverage68": _share_below(ratio, 1.5096),
        "coverage95": _share_below(ratio, 2.4477),
    }


def _share_below(values: Array, limit: float) -> float:
    return float(np.mean(values < limit)) if values.size else float("nan")


def _three(vector: Array) -> tuple[float, float, float]:
    x, y, z = vector.tolist()
    return x, y, z


def _theta_h_range(reconstruction: Reconstruction) -> tuple[float, float]:
    """Median over the pixels of the smallest and the largest half angle seen, degrees."""
    seen = reconstruction.fits.theta_h_range
    seen = seen[np.isfinite(seen[:, 0])]
    if len(seen) == 0:
        return float("nan"), float("nan")
    low, high = np.rad2deg(np.median(seen, axis=0)).tolist()
    return low, high


def _spread(n_views: int, n: int) -> NDArray[np.int64]:
    """Choose `n` of the views, evenly over the capture, neither the first nor the last unless all are chosen."""
    if n >= n_views:
        return np.arange(n_views)
    return np.unique(((np.arange(n) + 0.5) * n_views / n).astype(np.int64))
