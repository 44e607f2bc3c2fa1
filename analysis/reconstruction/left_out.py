"""A view left out of the fit, and what the others say it shows: the same values that a result would render."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.few_views import exposure
from analysis.few_views.method import FewViews, binning_for, solve_few_views
from analysis.few_views.solution import fits_of, materials_of
from analysis.palette.scene import ScenePalette, solve_scene, with_curves_refined
from analysis.pixels.fits import PixelFits
from analysis.pixels.problem import Noise, PixelProblem
from analysis.pixels.trimming import without_highlights
from analysis.reflectance.dictionary import Dictionary, lambertian
from analysis.registration.stack import Stack

Array = NDArray[np.float64]

Labels = NDArray[np.int64]

_N_TRIED, _N_SAMPLES, _FEWEST = 3, 3000, 300  # views, and pixels or squares of each

_TRIAL_PIXELS = 128**2  # of a picture in a trial

_DIM = 0.1  # of the typical sample: what is darker says nothing of a view's power


def fits_without(
    view: int,
    pixels: Labels,
    *,
    stack: Stack,
    dictionary: Dictionary,
    noise: Noise,
    depth: Array | None,
    scene: ScenePalette | None,
) -> PixelFits:
    """Fit some pixels to all views but one, over all angles; a palette's curves are refined without it.

    Parameters
    ----------
    view : int
    pixels : ndarray of int
        Flat indices.
    stack : Stack
    dictionary : Dictionary
    noise : Noise
    depth : ndarray, shape (H, W), or None
        Millimetres.
    scene : ScenePalette or None
        None = pixels on their own.
    """
    fewer = stack.without_view(view)
    if dictionary is lambertian():
        fewer = without_highlights(fewer)
    if scene is None:
        return PixelProblem(fewer, dictionary, pixels, depth).solve(noise)
    refined = with_curves_refined(scene, fewer, noise, depth)
    fits = solve_scene(refined, fewer, noise, depth, None, pixels=pixels)
    return replace(fits, dictionary=refined.brdfs(fewer, noise, depth).dictionary(fits.dictionary))


def predicted(fits: PixelFits, stack: Stack, view: int, pixels: Labels, depth: Array | None) -> Array:
    """Return what a view shows of some pixels by their fits, shape (P, C)."""
    points = stack.grid.points_of(pixels, None if depth is None else np.nan_to_num(depth))
    power = float(stack.light_power[view])
    return fits.radiance(points, stack.camera_position[view], stack.light_position[view], power)


@dataclass(frozen=True)
class Foretold:
    """A view as the other few say it.

    Attributes
    ----------
    stack : Stack
        All views, binned as they were for this.
    fits : PixelFits
        Without the view.
    radiance : ndarray, shape (P, C)
        With the power that the exposure law gives it.
    """

    stack: Stack
    fits: PixelFits
    radiance: Array


def foretold(view: int, few: FewViews, n: int, *, seed: int, threads: int | None) -> Foretold:
    """Solve a scene without one of its few views, and tell that view with the power that the others let expect.

    Parameters
    ----------
    view : int
    few : FewViews
        Of all views; nothing but the place of the light is taken from it.
    n : int
        By how much the stack is binned for this.
    seed, threads
        As `solve_few_views`.
    """
    # Powers as they were stated: those found have the view in them.
    stated = few.stack.light_power / np.exp(np.nan_to_num(few.log_power))
    stack = replace(few.stack, light_power=stated).binned(n)
    find_power = bool(np.nan_to_num(few.log_power).any())
    without = solve_few_views(stack.without_view(view), find_power=find_power, seed=seed, threads=threads)
    fits = fits_of(without)
    fits = replace(fits, dictionary=materials_of(without, fits).dictionary(fits.dictionary))
    pixels = np.arange(len(fits.normals))
    others = np.flatnonzero(np.isfinite(without.log_power))
    brightness = np.array([np.nanmean(predicted(fits, stack, v, pixels, None)) for v in (*others, view)])
    distance = np.linalg.norm(stack.camera_position, axis=1)
    log_power = exposure.foretold(
        without.log_power[others], distance[others], brightness[:-1], distance[[view]], brightness[-1:]
    )
    told = predicted(fits, stack, view, pixels, None) * np.exp(log_power[0])
    return Foretold(stack, fits, told)


@dataclass(frozen=True)
class Trial:
    """How well views that were left out were predicted: relative RMS after one free gain, median over the views.

    Attributes
    ----------
    palette : float
        Materials of solved pixels; infinite without a palette.
    alone : float
        Pixels on their own.
    colour : float
        Materials by colour.
    """

    palette: float
    alone: float
    colour: float

    @property
    def text(self) -> str:
        """The figures in words."""
        parts = [f"{self.colour:.0%} with materials by colour", f"{self.alone:.0%} by pixels on their own"]
        if np.isfinite(self.palette):
            parts.insert(1, f"{self.palette:.0%} with those of solved pixels")
        return f"views left out are predicted to {', '.join(parts)}"


def trial(
    few: FewViews,
    *,
    stack: Stack,
    dictionary: Dictionary,
    noise: Noise,
    depth: Array | None,
    scene: ScenePalette | None,
    seed: int,
    threads: int | None,
) -> Trial:
    """Leave a few views out in turn, and let each way to find materials predict them.

    All predict the same squares of pixels, those of `few` binned; one free gain takes off what nobody can know of a
    view's exposure.

    Parameters
    ----------
    few : FewViews
    stack, dictionary, noise, depth, scene
        As `fits_without`.
    seed, threads
        As `solve_few_views`.
    """
    rng = np.random.default_rng(seed)
    n = binning_for(few.stack, _TRIAL_PIXELS)
    palettes = {"palette": scene, "alone": None} if scene is not None else {"alone": None}
    errors: dict[str, list[float]] = {"palette": [], "alone": [], "colour": []}
    used = np.flatnonzero(np.isfinite(stack.light_power))
    for view in used[np.unique(np.linspace(0, len(used) - 1, _N_TRIED).round().astype(np.int64))].tolist():
        without = foretold(view, few, n, seed=seed, threads=threads)
        grid = without.stack.grid
        squares = np.sort(rng.permutation(grid.height * grid.width)[: max(_N_SAMPLES // n**2, _FEWEST)])
        measured = _measured(without.stack, view)[squares]
        errors["colour"].append(error_with_gain(without.radiance[squares], measured))
        pixels = _pixels_of(squares, grid.width, n, stack.grid.width).ravel()
        for name, palette in palettes.items():
            fits = fits_without(
                view, pixels, stack=stack, dictionary=dictionary, noise=noise, depth=depth, scene=palette
            )
            told = predicted(fits, stack, view, pixels, depth).reshape(len(squares), n * n, -1).mean(axis=1)
            errors[name].append(error_with_gain(told, measured))
    return Trial(*(float(np.median(e)) if e else np.inf for e in errors.values()))


def _measured(stack: Stack, view: int) -> Array:
    """Return what a view saw, shape (P, C); NaN = nothing, or clipped."""
    radiance = np.asarray(stack.radiance[view], np.float64)
    if stack.saturated is not None:
        radiance = np.where(np.asarray(stack.saturated[view]) > 0, np.nan, radiance)
    return radiance.reshape(-1, radiance.shape[-1])


def best_gain(told: Array, measured: Array) -> float:
    """Return the factor on a predicted picture that makes the typical sample right; 1 where nothing can be compared."""
    both = np.isfinite(told) & np.isfinite(measured)
    if not both.any():
        return 1.0
    bright = both & (told > _DIM * np.median(told[both])) & (measured > _DIM * np.median(measured[both]))
    return float(np.median(measured[bright] / told[bright])) if bright.any() else 1.0


def error_with_gain(told: Array, measured: Array) -> float:
    """Return sqrt(sum (g told - measured)^2 / sum measured^2) over what both have, g `best_gain`."""
    both = np.isfinite(told) & np.isfinite(measured)
    if not both.any():
        return float("inf")
    off = best_gain(told, measured) * told[both] - measured[both]
    return float(np.sqrt(np.sum(off**2) / np.sum(measured[both] ** 2)))


def _pixels_of(squares: Labels, width: int, n: int, full_width: int) -> Labels:
    """Return the flat indices of the n x n pixels of each square, shape (len(squares), n * n)."""
    row, column = np.divmod(squares, width)
    i, j = np.divmod(np.arange(n * n), n)
    return np.asarray((row[:, None] * n + i) * full_width + column[:, None] * n + j)
