"""Error on views that the fit did not see: the figure that tells whether a model predicts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.evaluation.metrics import psnr_db, relative_rms
from analysis.few_views.method import binning_for
from analysis.pixels.fits import PixelFits
from analysis.pixels.problem import PixelProblem, sample_pixels, samples_of
from analysis.pixels.samples import Samples
from analysis.reconstruction.left_out import error_with_gain, fits_without, foretold, predicted
from analysis.reconstruction.reconstruction import Reconstruction
from analysis.reflectance.dictionary import lambertian
from analysis.reflectance.models import Cosines
from analysis.results.summary import HeldOutView
from analysis.stages import Track, untracked

Array = NDArray[np.float64]

GLOSSY_CONTRAST = 2.0
"""A pixel is glossy if its curve at the smallest half angle seen is this many times that at 45 deg (or the
largest seen, if that is less)."""


def glossy_pixels(fits: PixelFits) -> NDArray[np.bool_]:
    """Return which pixels have a highlight within the half angles they were seen at."""
    near, far = fits.theta_h_range[:, 0], np.minimum(fits.theta_h_range[:, 1], np.deg2rad(45.0))
    known = np.isfinite(near)
    angles = np.stack([np.where(known, near, 0.0), np.where(known, far, 0.0)], axis=1)
    curve = fits.brdf(Cosines.on_slice(angles)).mean(axis=-1)
    return np.asarray(known & (curve[:, 0] > GLOSSY_CONTRAST * curve[:, 1]))


def hold_out(
    reconstruction: Reconstruction, views: NDArray[np.int64], pixels: NDArray[np.int64], track: Track = untracked
) -> tuple[HeldOutView, ...]:
    """Hold each of `views` out in turn, fit `pixels` anew without it, and predict it.

    Geometry (depth, poses, light) and the number of materials stay those of the full fit; a palette's curves are
    refined without the view, normals and shares start from nothing.

    Parameters
    ----------
    reconstruction : Reconstruction
    views : ndarray of int
    pixels : ndarray of int
        Flat indices into the area.
    track : Track
        Learns how many views are done.
    """
    if reconstruction.few_views is not None:
        return tuple(_hold_out_few(reconstruction, int(view), len(pixels)) for view in track(views.tolist()))
    glossy = glossy_pixels(reconstruction.fits)[pixels]
    samples = samples_of(reconstruction.stack, pixels)
    return tuple(_hold_out_one(reconstruction, int(view), pixels, samples, glossy) for view in track(views.tolist()))


def _hold_out_one(
    reconstruction: Reconstruction, view: int, pixels: NDArray[np.int64], samples: Samples, glossy: NDArray[np.bool_]
) -> HeldOutView:
    stack, noise, depth = reconstruction.stack, reconstruction.noise, reconstruction.depth
    fits = fits_without(
        view,
        pixels,
        stack=stack,
        dictionary=reconstruction.fits.dictionary,
        noise=noise,
        depth=depth,
        scene=reconstruction.palette,
    )
    ours = predicted(fits, stack, view, pixels, depth)
    # Plain least squares for the rival: a robust one would give up the highlights at once.
    problem = PixelProblem(stack.without_view(view), lambertian(), pixels, depth, samples)
    lambert = predicted(problem.solve(noise, robust=False), stack, view, pixels, depth)
    measured = np.where(samples.saturated[view] > 0, np.nan, samples.radiance[view].astype(np.float64))
    return _compared(view, ours, lambert, measured, glossy)


def _hold_out_few(reconstruction: Reconstruction, view: int, n_pixels: int) -> HeldOutView:
    """Leave a view of few out: all pixels are solved anew, since they have their materials and neighbours in common."""
    assert reconstruction.few_views is not None
    few = reconstruction.few_views
    told = foretold(view, few, binning_for(few.stack), seed=0, threads=None)
    stack = told.stack
    pixels = sample_pixels(stack, n_pixels, np.random.default_rng(0))
    samples = samples_of(stack, pixels)
    rival = PixelProblem(stack.without_view(view), lambertian(), pixels, None, samples)
    lambert = predicted(rival.solve(reconstruction.noise, robust=False), stack, view, pixels, None)
    measured = np.where(samples.saturated[view] > 0, np.nan, samples.radiance[view].astype(np.float64))
    return _compared(view, told.radiance[pixels], lambert, measured, glossy_pixels(told.fits)[pixels])


def _compared(view: int, ours: Array, lambert: Array, measured: Array, glossy: NDArray[np.bool_]) -> HeldOutView:
    common = np.isfinite(ours) & np.isfinite(lambert) & np.isfinite(measured)
    measured = np.where(common, measured, np.nan)
    peak = float(np.nanmax(measured)) if common.any() else float("nan")
    shiny = np.where(glossy[:, None], measured, np.nan)
    return HeldOutView(
        view=view,
        n_pixels=int(common.any(axis=1).sum()),
        n_glossy=int((common.any(axis=1) & glossy).sum()),
        relative_rms=relative_rms(ours, measured),
        lambert_relative_rms=relative_rms(lambert, measured),
        relative_rms_with_gain=error_with_gain(ours, measured),
        psnr_db=psnr_db(ours, measured, peak),
        lambert_psnr_db=psnr_db(lambert, measured, peak),
        glossy_gain_db=psnr_db(ours, shiny, peak) - psnr_db(lambert, shiny, peak),
    )
