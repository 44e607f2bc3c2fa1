"""Figures of a reconstruction: against the truth where there is one, and on views left out of the fit."""

from __future__ import annotations

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.evaluation.held_out import glossy_pixels, leave_out
from analysis.evaluation.metrics import (
    angular_error_deg,
    depth_rmse,
    depth_rmse_without_plane,
    error_summary,
    shape_terms,
)
from analysis.pixels.problem import sample_pixels
from analysis.reconstruction.reconstruction import Reconstruction

Array = NDArray[np.float64]


def truth_error(reconstruction: Reconstruction) -> Array | None:
    """Return the angular error of each pixel in degrees, shape (H, W), or None without a truth."""
    truth = reconstruction.stack.truth
    return None if truth is None else angular_error_deg(reconstruction.normals, truth.normals)


def score(reconstruction: Reconstruction, n_left_out: int = 6, n_pixels: int = 2000) -> dict[str, Any]:
    """Return the figures that a report and a program want.

    Parameters
    ----------
    reconstruction : Reconstruction
    n_left_out : int
        Views that are left out in turn, spread evenly over the capture; 0 = none.
    n_pixels : int
        Pixels on which they are predicted, drawn with a fixed seed.
    """
    stack, fits = reconstruction.stack, reconstruction.fits
    solved = np.isfinite(fits.normals[:, 0])
    summary: dict[str, Any] = {
        "n_views": stack.n_views,
        "n_pixels": int(solved.size),
        "n_unsolved": int(np.count_nonzero(~solved)),
        "pixel_pitch_mm": stack.pixel_pitch,
        "share_glossy": float(glossy_pixels(fits)[solved].mean()) if solved.any() else float("nan"),
        "theta_h_range_deg": _theta_h_range(reconstruction),
        "normal_sigma_deg": error_summary(np.rad2deg(fits.normal_sigma)),
        "reduced_chi2": error_summary(fits.reduced_chi2),
        "relative_error": reconstruction.noise.relative,
    }
    if np.isfinite(reconstruction.depth).sum() > 5:
        summary["depth_shape"] = asdict(shape_terms(reconstruction.depth, stack.pixel_pitch))
    if reconstruction.palette is not None:
        summary["n_materials"] = reconstruction.palette.found.palette.n_materials
    if reconstruction.light_offset is not None:
        summary["light_offset_mm"] = reconstruction.light_offset.value.tolist()
        summary["light_offset_sigma_mm"] = reconstruction.light_offset.sigma.tolist()
    if reconstruction.budget is not None:
        summary["error_budget_deg"] = reconstruction.budget.contributions
    error = truth_error(reconstruction)
    if error is not None and stack.truth is not None:
        summary["normal_error_deg"] = error_summary(error)
        summary["depth_rmse_mm"] = depth_rmse(reconstruction.depth, stack.truth.depth)
        summary["depth_rmse_without_plane_mm"] = depth_rmse_without_plane(reconstruction.depth, stack.truth.depth)
        # Of a two-dimensional Gaussian error with sigma per axis, 68 % lie within 1.51 sigma, 95 % within 2.45.
        ratio = error.ravel() / np.rad2deg(fits.normal_sigma)
        summary["coverage68"] = float(np.mean(ratio[np.isfinite(ratio)] < 1.5096))
        summary["coverage95"] = float(np.mean(ratio[np.isfinite(ratio)] < 2.4477))
    views = _spread(stack.n_views, n_left_out)
    pixels = sample_pixels(stack, n_pixels, np.random.default_rng(0))
    summary["left_out"] = [view.as_dict() for view in leave_out(reconstruction, views, pixels)]
    return summary


def _theta_h_range(reconstruction: Reconstruction) -> list[float]:
    """Median over the pixels of the smallest and the largest half angle seen, degrees."""
    seen = reconstruction.fits.theta_h_range
    seen = seen[np.isfinite(seen[:, 0])]
    return np.rad2deg(np.median(seen, axis=0)).tolist() if len(seen) else [float("nan")] * 2


def _spread(n_views: int, n: int) -> NDArray[np.int64]:
    """Choose `n` of the views, evenly over the capture, neither the first nor the last unless all are chosen."""
    if n >= n_views:
        return np.arange(n_views)
    return np.unique(((np.arange(n) + 0.5) * n_views / n).astype(np.int64))
