"""Solves many pixels of a stack with the per-pixel solver, in threads; estimates their noise level."""

from __future__ import annotations

import os
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.pixels import solver
from analysis.pixels.fits import PixelFits
from analysis.pixels.nnls import MAX_ATOMS
from analysis.pixels.parallax import follow_pixels
from analysis.pixels.samples import MIN_VIEWS, NEAR_PLANAR, Geometry, Samples, Settings
from analysis.pixels.solver import Solution
from analysis.reflectance.dictionary import Dictionary
from analysis.reflectance.models import GRAZING, Cosines
from analysis.reflectance.palette import MATERIAL_GAIN, MAX_MATERIALS, Palette
from analysis.registration.stack import Stack

Array = NDArray[np.float64]

TILE = 2**16
"""Pixels that are taken out of a stack at a time; results do not depend on it."""

_NOISE_ROUNDS, _BISECTIONS = 3, 20

_RELATIVE_ERRORS = (1e-4, 0.2)  # between which the truth lies

_MEDIAN_CHI2 = 0.4549  # median of chi-square with one degree of freedom

# Pixels a thread takes at a time: small enough to balance, large enough that handing over does not matter.
_MIN_CHUNK, _MAX_CHUNK, _CHUNKS_A_THREAD = 32, 512, 8


def n_threads() -> int:
    """Return how many processors this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@dataclass(frozen=True)
class Noise:
    """How far radiances may be from the model, one sigma: sqrt(variance + (relative m)^2 + floor^2).

    Attributes
    ----------
    relative : float
        Calibration and model error, as a share of the radiance.
    floor : float
        Radiance units.
    """

    relative: float
    floor: float


@dataclass(frozen=True)
class NormalPrior:
    """What is likely of normals beforehand.

    Attributes
    ----------
    normal : ndarray, shape (P, 3)
        Unit vectors.
    sigma : ndarray, shape (P,)
        One standard deviation a tangent axis, rad.
    """

    normal: Array
    sigma: Array

    def select(self, pixels: NDArray[np.int64]) -> NormalPrior:
        """Return that of these pixels only."""
        return NormalPrior(self.normal[pixels], self.sigma[pixels])

    @classmethod
    def near_planar(cls, n_pixels: int) -> NormalPrior:
        """Return what is known of near-planar samples (`NEAR_PLANAR`)."""
        return cls(np.tile([0.0, 0.0, 1.0], (n_pixels, 1)), np.full(n_pixels, NEAR_PLANAR))


class PixelProblem:
    """Pixels of a stack, ready to be solved with a dictionary.

    Parameters
    ----------
    stack : Stack
    dictionary : Dictionary
    pixels : ndarray of int, shape (P,), or None
        Flat indices of the pixels to take; None = all.
    depth : ndarray, shape (H, W), or None
        Millimetres; None = flat.
    samples : Samples or None
        Of the pixels; None = those of the stack.
    """

    def __init__(
        self,
        stack: Stack,
        dictionary: Dictionary,
        pixels: NDArray[np.int64] | None = None,
        depth: Array | None = None,
        samples: Samples | None = None,
    ) -> None:
        self.dictionary = dictionary
        self.pixels = np.arange(stack.grid.height * stack.grid.width) if pixels is None else pixels
        self.stack = stack
        self.points = stack.grid.points_of(self.pixels, None if depth is None else np.nan_to_num(depth))
        self.samples = samples or samples_of(stack, self.pixels)

    def select(self, pixels: NDArray[np.int64]) -> PixelProblem:
        """Return the problem of these of its pixels (indices into `pixels`) only."""
        part = copy(self)
        part.pixels, part.points = self.pixels[pixels], self.points[pixels]
        part.samples = Samples(
            np.ascontiguousarray(self.samples.radiance[:, pixels]),
            np.ascontiguousarray(self.samples.variance[:, pixels]),
            np.ascontiguousarray(self.samples.saturated[:, pixels]),
        )
        return part

    def directions(self) -> tuple[Array, Array]:
        """Return omega_i and h of every view and pixel, each of shape (N, P, 3)."""
        to_light = self.stack.light_position[:, None] - self.points
        to_camera = self.stack.camera_position[:, None] - self.points
        omega_i = to_light / np.linalg.norm(to_light, axis=-1, keepdims=True)
        h = omega_i + to_camera / np.linalg.norm(to_camera, axis=-1, keepdims=True)
        return omega_i, h / np.linalg.norm(h, axis=-1, keepdims=True)

    def gain(self) -> Array:
        """Return d^2 / P, which frees a radiance of fall-off and power, shape (N, P)."""
        d2 = np.sum((self.stack.light_position[:, None] - self.points) ** 2, axis=-1)
        return np.asarray(d2 / self.stack.light_power[:, None])

    def solve(
        self,
        noise: Noise,
        *,
        start: Array | None = None,
        light_position: Array | None = None,
        tolerance: float = 2.0,
        robust: bool = True,
        prior: NormalPrior | None = None,
        threads: int | None = None,
    ) -> PixelFits:
        """Solve every pixel.

        Parameters
        ----------
        noise : Noise
        start : ndarray, shape (P, 3), or None
            Normals to go on from; the usual starts are tried only where this is NaN.
        light_position : ndarray, shape (N, 3), or None
            Instead of the stack's.
        tolerance : float
            Gain in chi-square that an atom must bring to be used.
        robust : bool
            Weigh down views that do not fit.
        prior : NormalPrior or None
            None = `NormalPrior.near_planar`.
        threads : int or None
            None = all processors; the result does not depend on it.
        """
        settings = Settings(noise.relative, noise.floor, tolerance, MAX_ATOMS, robust, shared=False, cold=False)
        table = self.dictionary.slice_table()
        geometry = self.geometry(start, light_position, prior)
        out = self._run(settings, table.value[None], table.derivative[None], geometry, threads)
        coefficient = out.coefficient / table.scale[np.maximum(out.atom, 0)]
        return _fits(out, self.dictionary, out.atom, coefficient)

    def solve_with_palette(
        self,
        palette: Palette,
        noise: Noise,
        *,
        start: Array | None = None,
        cold: bool = True,
        prior: NormalPrior | None = None,
        threads: int | None = None,
    ) -> PixelFits:
        """Solve every pixel as a mixture of few of the palette's materials.

        Parameters
        ----------
        palette : Palette
        noise, start, prior, threads
            As `solve`.
        cold : bool
            Try the usual starts too where the one given does not fit.
        """
        n_channels = self.samples.radiance.shape[2]
        settings = Settings(noise.relative, noise.floor, MATERIAL_GAIN, MAX_MATERIALS, True, shared=True, cold=cold)
        out = self._run(settings, *palette.tables(), self.geometry(start, None, prior), threads)
        atom = np.where(out.atom >= 0, n_channels * out.atom + np.arange(n_channels)[:, None], -1).astype(np.int16)
        coefficient = np.repeat(out.coefficient, n_channels, axis=1)
        return _fits(out, palette.dictionary, atom, coefficient)

    def geometry(
        self, start: Array | None = None, light_position: Array | None = None, prior: NormalPrior | None = None
    ) -> Geometry:
        """Return where everything is, as the kernels take it."""
        prior = prior or NormalPrior.near_planar(len(self.points))
        light = self.stack.light_position if light_position is None else light_position
        return Geometry(
            self.stack.camera_position,
            np.ascontiguousarray(light),
            self.stack.light_power,
            self.points,
            np.full((len(self.points), 3), np.nan) if start is None else start,
            np.concatenate([prior.normal, prior.sigma[:, None] ** -2.0], axis=1),
        )

    def _run(
        self,
        settings: Settings,
        value: NDArray[np.float32],
        derivative: NDArray[np.float32],
        geometry: Geometry,
        threads: int | None,
    ) -> Solution:
        n_pixels, n_channels = self.samples.radiance.shape[1:]
        n_groups = 1 if settings.shared else n_channels
        out = Solution(
            np.empty((n_pixels, 3)),
            np.empty((n_pixels, 3)),
            np.empty(n_pixels),
            np.empty(n_pixels),
            np.empty((n_pixels, n_groups, MAX_ATOMS), np.int16),
            np.empty((n_pixels, n_groups, MAX_ATOMS)),
            np.zeros(n_pixels, np.uint8),
            np.empty((n_pixels, 2)),
        )

        n = threads or n_threads()
        size = min(max(n_pixels // (n * _CHUNKS_A_THREAD), _MIN_CHUNK), _MAX_CHUNK)

        def chunk(first: int) -> None:
            last = min(first + size, n_pixels)
            solver.solve_pixels(self.samples, geometry, settings, value, derivative, first, last, out)

        with ThreadPoolExecutor(n) as pool:
            list(pool.map(chunk, range(0, n_pixels, size)))
        return out

    def model(self, fits: PixelFits) -> Array:
        """Return what `fits` say of every sample, shape (N, P, C), on the slice theta_d = 0 as they were fitted."""
        omega_i, h = self.directions()
        n_dot_l = np.maximum(np.sum(fits.normals * omega_i, axis=-1), 0.0)
        n_dot_h = np.clip(np.sum(fits.normals * h, axis=-1), GRAZING, 1.0).T
        f = fits.brdf(Cosines(n_dot_h, np.ones_like(n_dot_h), n_dot_h, n_dot_h))
        return np.asarray(np.moveaxis(f, 1, 0) * (n_dot_l / self.gain())[..., None])


def _fits(out: Solution, dictionary: Dictionary, atom: NDArray[np.int16], coefficient: Array) -> PixelFits:
    low, high = out.n_dot_h_range[:, 0], out.n_dot_h_range[:, 1]
    return PixelFits(
        normals=out.normal,
        covariance=out.covariance,
        reduced_chi2=out.reduced_chi2,
        loss=out.loss,
        atom=atom,
        coefficient=coefficient,
        flags=out.flags,
        theta_h_range=np.arccos(np.clip(np.stack([high, low], axis=1), -1.0, 1.0)),
        dictionary=dictionary,
    )


def model_error_share(stack: Stack, noise: Noise, rng: np.random.Generator) -> float:
    """Return which share of the typical sample's variance is not its own noise but the model's error.

    Neighbours have the model's error in common, so that a mean over them leaves it as it is.
    """
    samples = samples_of(stack, sample_pixels(stack, 600, rng))
    own = samples.variance.astype(np.float64) + noise.floor**2
    model = (noise.relative * samples.radiance.astype(np.float64)) ** 2
    seen = np.isfinite(model) & np.isfinite(own) & (samples.saturated == 0)
    return float(np.median((model / (own + model))[seen])) if seen.any() else 1.0


def samples_of(stack: Stack, pixels: NDArray[np.int64]) -> Samples:
    """Take the samples of some pixels (flat indices) out of a stack, along the depth that it follows if it does."""
    if stack.followed is not None:
        return follow_pixels(stack, stack.followed, pixels)
    n, _, width, n_channels = stack.radiance.shape
    shape = (n, len(pixels), n_channels)
    if len(pixels) == 0:
        return Samples(np.zeros(shape, np.float32), np.zeros(shape, np.float32), np.zeros(shape, np.uint8))
    first, last = int(pixels.min()) // width, int(pixels.max()) // width + 1
    places: Any = pixels - first * width
    if len(pixels) == places[-1] - places[0] + 1 and np.all(np.diff(places) == 1):
        # Neighbours in reading order, as tiles are, are copied faster by a slice.
        places = slice(places[0], places[-1] + 1)

    def taken(a: Any, dtype: type[Any]) -> NDArray[Any]:
        out = np.empty(shape, dtype)
        for v in range(n):
            out[v] = a[v, first:last].reshape(-1, n_channels)[places]
        return out

    return Samples(
        taken(stack.radiance, np.float32),
        np.zeros(shape, np.float32) if stack.variance is None else taken(stack.variance, np.float32),
        np.zeros(shape, np.uint8) if stack.saturated is None else taken(stack.saturated, np.uint8),
    )


def tiles(pixels: NDArray[np.int64]) -> Iterator[NDArray[np.int64]]:
    """Cut pixels into tiles of at most `TILE`, so that memory stays the same for any area."""
    for first in range(0, len(pixels), TILE):
        yield pixels[first : first + TILE]


def sample_pixels(stack: Stack, n_pixels: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Draw at most `n_pixels` pixels that enough views see, in ascending order."""
    # View by view, since the stack may be on disk and a mask of all samples would be a quarter of it.
    n_views, height, width, n_channels = stack.radiance.shape
    seen = np.zeros(height * width, np.int64)
    for v in range(n_views):
        view = stack.radiance[v].reshape(-1, n_channels)
        seen += np.logical_and.reduce([np.isfinite(view[:, ch]) for ch in range(n_channels)])
    candidates = np.flatnonzero(seen >= min(MIN_VIEWS, stack.n_views))
    if len(candidates) <= n_pixels:
        return candidates
    return np.sort(rng.choice(candidates, n_pixels, replace=False))


def estimate_noise(stack: Stack, dictionary: Dictionary, rng: np.random.Generator) -> Noise:
    """Find the relative error that makes the typical residual fit its stated sigma.

    The variance in a stack covers counting noise, not what calibration and registration left over. On a
    sample of pixels the relative error is chosen so that the median squared residual over its variance is
    that of a Gaussian. The median, because a few wrong samples a pixel would pass for noise everywhere.

    Parameters
    ----------
    stack : Stack
    dictionary : Dictionary
    rng : numpy.random.Generator
        Draws the pixels.
    """
    problem = PixelProblem(stack, dictionary, sample_pixels(stack, 600, rng))
    level = float(np.nanmedian(np.abs(problem.samples.radiance)))
    # Without a stated variance something must hold up the dark samples: a thousandth of the typical radiance.
    floor = (1e-3 if stack.variance is None else 1e-5) * level
    noise = Noise(0.01, floor)
    for _ in range(_NOISE_ROUNDS):
        fits = problem.solve(noise)
        if not np.isfinite(fits.reduced_chi2).any():
            return noise
        noise = refined_noise(problem, fits, noise)
    return noise


def refined_noise(problem: PixelProblem, fits: PixelFits, noise: Noise) -> Noise:
    """Return the noise at whose relative error the median of r^2 / (variance + (relative m)^2) is a Gaussian's."""
    floor = noise.floor
    samples, model = problem.samples, problem.model(fits)
    valid = np.isfinite(samples.radiance) & np.isfinite(model) & (samples.saturated == 0)
    n_samples = valid.sum(axis=(0, 2))
    n_unknowns = 2 + fits.n_coefficients
    # What the fit took out of the residuals.
    left = np.maximum(n_samples - n_unknowns, 1) / np.maximum(n_samples, 1)
    r2 = ((samples.radiance - model) ** 2 / left[:, None])[valid]
    base, m2 = samples.variance[valid].astype(np.float64) + floor**2, model[valid] ** 2
    low, high = _RELATIVE_ERRORS
    for _ in range(_BISECTIONS):
        middle = float(np.sqrt(low * high))
        too_low = np.median(r2 / (base + middle**2 * m2)) > _MEDIAN_CHI2
        low, high = (middle, high) if too_low else (low, middle)
    return replace(noise, relative=float(np.sqrt(low * high)))
