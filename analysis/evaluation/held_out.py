"""Error on views that the fit did not see: the figure that tells whether a model predicts."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.evaluation.metrics import psnr_db, relative_rms
from analysis.palette.scene import solve_scene, with_curves_refined
from analysis.pixels.fits import PixelFits
from analysis.pixels.problem import PixelProblem, samples_of
from analysis.pixels.samples import Samples
from analysis.reconstruction.reconstruction import Reconstruction
from analysis.reflectance.dictionary import Atom, Dictionary
from analysis.reflectance.models import Cosines
from analysis.registration.stack import Stack
from analysis.results.summary import HeldOutView
from analysis.stages import Track, untracked

Array = NDArray[np.float64]

LAMBERT = Dictionary("lambert", (Atom("lambert"),))

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
    glossy = glossy_pixels(reconstruction.fits)[pixels]
    samples = samples_of(reconstruction.stack, pixels)
    return tuple(_hold_out_one(reconstruction, int(view), pixels, samples, glossy) for view in track(views.tolist()))


def _hold_out_one(
    reconstruction: Reconstruction, view: int, pixels: NDArray[np.int64], samples: Samples, glossy: NDArray[np.bool_]
) -> HeldOutView:
    stack, noise = reconstruction.stack, reconstruction.noise
    measured = np.where(samples.saturated[view] > 0, np.nan, samples.radiance[view].astype(np.float64))
    fewer = stack.without_view(view)
    ours = _predict(reconstruction, _fits_without(reconstruction, fewer, pixels), view, pixels)
    # Plain least squares for the rival: a robust one would give up the highlights at once.
    rival = PixelProblem(fewer, LAMBERT, pixels, reconstruction.depth, samples).solve(noise, robust=False)
    lambert = _predict(reconstruction, rival, view, pixels)
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
        psnr_db=psnr_db(ours, measured, peak),
        lambert_psnr_db=psnr_db(lambert, measured, peak),
        glossy_gain_db=psnr_db(ours, shiny, peak) - psnr_db(lambert, shiny, peak),
    )


def _fits_without(reconstruction: Reconstruction, fewer: Stack, pixels: NDArray[np.int64]) -> PixelFits:
    """Fit `pixels` to fewer views, the palette's curves refined without the one left out."""
    noise, depth, scene = reconstruction.noise, reconstruction.depth, reconstruction.palette
    if scene is None:
        return PixelProblem(fewer, reconstruction.fits.dictionary, pixels, depth).solve(noise)
    refined = with_curves_refined(scene, fewer, noise, depth)
    return solve_scene(refined, fewer, noise, depth, None, pixels=pixels)


def _predict(reconstruction: Reconstruction, fits: PixelFits, view: int, pixels: NDArray[np.int64]) -> Array:
    stack = reconstruction.stack
    points = stack.grid.points(np.nan_to_num(reconstruction.depth)).reshape(-1, 3)[pixels]
    power = float(stack.light_power[view])
    return fits.radiance(points, stack.camera_position[view], stack.light_position[view], power)
