"""A palette applied to a scene: learnt on a grid of pixels, used on all, left where it does not hold.

The grid's pixels are also solved on their own. Where their neighbourhood fits so much better by itself than
by the palette, the pixels there are none of its materials and are solved on their own; where that is most of
the scene, there is no palette.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt, map_coordinates, median_filter

from analysis.depth.integration import integrate_normals
from analysis.palette.materials import leading_material
from analysis.palette.search import PaletteFit, curve_sigma, curve_variance, find_palette, refine_palette
from analysis.pixels.fits import PixelFits, joined
from analysis.pixels.problem import Noise, NormalPrior, PixelProblem, refined_noise, tiles
from analysis.reflectance.dictionary import Dictionary
from analysis.reflectance.palette_completion import MaterialBrdfs, complete_palette
from analysis.registration.stack import Stack
from analysis.stages import Track, untracked

Array = NDArray[np.float64]

N_LEARNT = 3000
"""At most so many pixels a palette is learnt from: their curves' error is then far below a pixel's own."""

MIN_SOLVED = 20
"""Pixels of the grid below which no curve is learnt from them."""

UNFIT_EXCESS = 0.05
"""Excess of log(1 + loss), the loss taken a degree of freedom, with the palette over that of pixels on their
own, in the median of a neighbourhood, above which the palette does not hold there. Single pixels are not judged:
with three times the freedom their own fit always looks better."""

NO_PALETTE_SHARE = 0.7
"""Share of the scene without the palette's materials beyond which there is no palette. Above a half, since views
that do not yet follow the surface fit badly too, and are looked at again once they do."""

_NEIGHBOURHOOD = 3  # pixels of the grid, a side

_N_ASKED = 40  # pixels of each material whose normals are asked how they hang on the curves


@dataclass(frozen=True)
class ScenePalette:
    """A palette, and where in the scene it holds.

    Attributes
    ----------
    found : PaletteFit
        Of the grid's pixels.
    own : PixelFits
        The grid's pixels on their own.
    rows, columns : ndarray of int
        Of the grid.
    unfit : ndarray of bool, shape (len(rows), len(columns))
        Where the palette does not hold.
    """

    found: PaletteFit
    own: PixelFits
    rows: NDArray[np.int64]
    columns: NDArray[np.int64]
    unfit: NDArray[np.bool_]

    @property
    def unfit_share(self) -> float:
        """Share of the grid where the palette does not hold."""
        return float(self.unfit.mean())

    def noise(self, stack: Stack, before: Noise, depth: Array | None = None) -> Noise:
        """Return the noise level at which the typical residual of the palette's pixels is one of its sigma."""
        _, _, problem = _grid(stack, self.own.dictionary, depth)
        fit = np.flatnonzero(~self.unfit.ravel() & np.isfinite(self.found.fits.normals[:, 0]))
        if len(fit) == 0:
            return before
        return refined_noise(problem.select(fit), self.found.fits.select(fit), before)

    def power_factors(self, stack: Stack) -> Array:
        """Return by how much each view is brighter than its stated light power says, shape (N,), mean 1."""
        _, _, problem = _grid(stack, self.own.dictionary, None)
        samples, model = problem.samples, problem.model(self.found.fits)
        good = np.isfinite(samples.radiance) & (samples.saturated == 0)
        good &= model > 0.1 * np.nanmedian(model)
        ratio = np.where(good, samples.radiance / np.where(good, model, 1.0), np.nan).reshape(stack.n_views, -1)
        # A view that sees none of these pixels keeps its power.
        factor = np.array([np.nanmedian(r) if np.isfinite(r).any() else 1.0 for r in ratio])
        return np.asarray(factor / factor.mean())

    def brdfs(self, stack: Stack, noise: Noise, depth: Array | None) -> MaterialBrdfs:
        """Return the materials over all angles, with their band."""
        _, _, problem = _grid(stack, self.own.dictionary, depth)
        sigma = curve_sigma(problem, self.found, noise)
        leading, ranges = leading_material(self.found.fits), self.found.fits.theta_h_range
        everywhere = np.nanmedian(ranges, axis=0)
        seen = np.stack([_seen(ranges[leading == k], everywhere) for k in range(len(sigma))])
        return complete_palette(self.found.palette, sigma, seen)

    def depth(self, stack: Stack) -> Array:
        """Return the depth of the area from the grid's normals alone, shape (H, W), mm."""
        normals = self.found.fits.normals.reshape(len(self.rows), len(self.columns), 3)
        strides = [*np.diff(self.rows[:2]), *np.diff(self.columns[:2]), 1]
        coarse = integrate_normals(normals, float(strides[0]) * stack.pixel_pitch)
        shape = stack.radiance.shape[1:3]
        return _upsampled(coarse[..., None], self, shape)[..., 0]


def learn(
    stack: Stack, dictionary: Dictionary, noise: Noise, depth: Array | None, rng: np.random.Generator
) -> ScenePalette | None:
    """Learn the palette of a scene; None if fewer than `MIN_SOLVED` of the grid's pixels can be solved.

    Parameters
    ----------
    stack : Stack
    dictionary : Dictionary
        Of the pixels on their own and of the first curves.
    noise : Noise
    depth : ndarray, shape (H, W), or None
        Millimetres; None = flat.
    rng : numpy.random.Generator
    """
    rows, columns, problem = _grid(stack, dictionary, depth)
    own = problem.solve(noise)
    if np.isfinite(own.normals[:, 0]).sum() < MIN_SOLVED:
        return None
    found = find_palette(problem, own, noise, rng)
    return ScenePalette(found, own, rows, columns, _unfit(found, own, len(rows), stack.n_views))


def relearn(scene: ScenePalette, stack: Stack, noise: Noise, depth: Array | None) -> ScenePalette:
    """Refine the palette with a new depth, light or noise, and look again where it holds."""
    _, _, problem = _grid(stack, scene.own.dictionary, depth)
    own = problem.solve(noise, start=scene.own.normals)
    found = refine_palette(problem, own, noise, scene.found)
    return ScenePalette(found, own, scene.rows, scene.columns, _unfit(found, own, len(scene.rows), stack.n_views))


def with_curves_refined(scene: ScenePalette, stack: Stack, noise: Noise, depth: Array | None) -> ScenePalette:
    """Refine the palette's curves alone, for samples that are nearly the same."""
    _, _, problem = _grid(stack, scene.own.dictionary, depth)
    return replace(scene, found=refine_palette(problem, scene.own, noise, scene.found))


def solve_scene(
    scene: ScenePalette,
    stack: Stack,
    noise: Noise,
    depth: Array | None,
    start: Array | None,
    *,
    pixels: NDArray[np.int64] | None = None,
    prior: NormalPrior | None = None,
    threads: int | None = None,
    track: Track = untracked,
) -> PixelFits:
    """Solve the pixels of a scene with its palette, and on their own those where it does not hold.

    Parameters
    ----------
    scene : ScenePalette
    stack : Stack
    noise : Noise
    depth : ndarray, shape (H, W), or None
    start : ndarray, shape (P, 3), or None
        Normals to go on from; None = the grid's, between its pixels.
    pixels : ndarray of int, shape (P,), or None
        Flat indices of the pixels to solve; None = all.
    prior : NormalPrior or None
        Of these pixels; None = near-planar.
    threads : int or None
    track : Track
        Learns how many tiles of pixels are done.
    """
    shape = stack.radiance.shape[1:3]
    pixels = np.arange(shape[0] * shape[1]) if pixels is None else pixels
    begin = _between(scene, shape)[pixels] if start is None else start
    palette, dictionary = scene.found.palette, scene.own.dictionary
    prior = prior or NormalPrior.near_planar(len(pixels))
    places = np.arange(len(pixels))
    fits = joined(
        [
            PixelProblem(stack, dictionary, pixels[tile], depth).solve_with_palette(
                palette, noise, start=begin[tile], cold=start is None, prior=prior.select(tile), threads=threads
            )
            for tile in track(list(tiles(places)))
        ]
    )
    apart = np.flatnonzero(_nearest(scene.unfit, scene, shape).ravel()[pixels])
    if len(apart) == 0:
        return fits
    own = [
        PixelProblem(stack, dictionary, pixels[tile], depth).solve(
            noise, start=None if start is None else start[tile], prior=prior.select(tile), threads=threads
        )
        for tile in tiles(apart)
    ]
    return fits.replaced(apart, joined(own))


def _seen(ranges: Array, otherwise: Array) -> Array:
    """Half angles from and to which a material was seen, but by a few pixels."""
    if len(ranges) == 0:
        return otherwise
    return np.array([np.nanpercentile(ranges[:, 0], 1), min(np.nanpercentile(ranges[:, 1], 95), np.deg2rad(85.0))])


def _grid(
    stack: Stack, dictionary: Dictionary, depth: Array | None
) -> tuple[NDArray[np.int64], NDArray[np.int64], PixelProblem]:
    height, width = stack.radiance.shape[1:3]
    stride = int(np.ceil(np.sqrt(height * width / N_LEARNT)))
    rows, columns = (np.arange((n % stride or stride) // 2, n, stride) for n in (height, width))
    pixels = (rows[:, None] * width + columns).ravel()
    return rows, columns, PixelProblem(stack, dictionary, pixels, depth)


def _unfit(found: PaletteFit, own: PixelFits, n_rows: int, n_views: int) -> NDArray[np.bool_]:
    # The loss a degree of freedom: with few views a pixel's own curve passes through anything.
    n_samples = own.atom.shape[1] * n_views
    palette_loss, own_loss = (
        np.log1p(fits.loss * n_samples / np.maximum(n_samples - 2 - fits.n_coefficients, 1))
        for fits in (found.fits, own)
    )
    excess = np.nan_to_num(palette_loss - own_loss).reshape(n_rows, -1)
    return np.asarray(median_filter(excess, _NEIGHBOURHOOD, mode="nearest") > UNFIT_EXCESS)


def _places(scene: ScenePalette, shape: tuple[int, ...]) -> tuple[Array, Array]:
    """Where the pixels of the area lie on the grid, in units of its spacing."""
    i, j = (
        np.interp(np.arange(n), at, np.arange(len(at), dtype=np.float64)) if len(at) > 1 else np.zeros(n)
        for n, at in zip(shape, (scene.rows, scene.columns), strict=True)
    )
    return np.meshgrid(i, j, indexing="ij")


def _nearest(values: NDArray[np.bool_], scene: ScenePalette, shape: tuple[int, ...]) -> NDArray[np.bool_]:
    i, j = _places(scene, shape)
    return np.asarray(values[np.rint(i).astype(np.int64), np.rint(j).astype(np.int64)])


def _between(scene: ScenePalette, shape: tuple[int, ...]) -> Array:
    """Interpolate the grid's normals to all pixels, shape (H * W, 3)."""
    n = _upsampled(scene.found.fits.normals.reshape(len(scene.rows), len(scene.columns), 3), scene, shape)
    return np.asarray((n / np.linalg.norm(n, axis=-1, keepdims=True)).reshape(-1, 3))


def _upsampled(values: Array, scene: ScenePalette, shape: tuple[int, ...]) -> Array:
    """Interpolate values on the grid, shape (rows, columns, E), to all pixels; gaps take the nearest value."""
    missing = np.isnan(values[..., 0])
    if missing.all():
        return np.full((*shape, values.shape[-1]), np.nan)
    _, (i, j) = distance_transform_edt(missing, return_indices=True)
    filled, places = values[i, j], np.stack(_places(scene, shape))
    parts = [map_coordinates(filled[..., e], places, order=1, mode="nearest") for e in range(values.shape[-1])]
    return np.stack(parts, axis=-1)


def with_curve_error(
    fits: PixelFits, scene: ScenePalette, stack: Stack, noise: Noise, depth: Array | None
) -> PixelFits:
    """Add to the normals' covariance what the error of the curves themselves brings, by material.

    It is known on the grid's pixels; one of the same leading material takes their median.
    """
    _, _, problem = _grid(stack, scene.own.dictionary, depth)
    leading, leading_grid = (leading_material(f) for f in (fits, scene.found.fits))
    added = np.zeros(len(leading))
    n_materials = scene.found.palette.n_materials
    asked = np.concatenate([np.flatnonzero(leading_grid == k)[:_N_ASKED] for k in range(n_materials)])
    variance = np.full(len(leading_grid), np.nan)
    variance[asked] = curve_variance(problem, scene.found, noise, asked)
    for k in range(n_materials):
        known = variance[(leading_grid == k) & np.isfinite(variance)]
        if len(known):
            added[leading == k] = np.median(known)
    return replace(fits, covariance=fits.covariance + added[:, None] * np.array([1.0, 0.0, 1.0]))
