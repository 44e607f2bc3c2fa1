"""Many pixels of a stack through the per-pixel solver: threads, noise level, prediction of views."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis import pixel_solver
from analysis.dictionary import MODELS, Dictionary
from analysis.nnls import MAX_ATOMS
from analysis.pixel_solver import Geometry, Samples, Settings, Solution
from analysis.reflectance import GRAZING, Cosines
from analysis.stack import Stack

Array = NDArray[np.float64]

_NOISE_ROUNDS, _BISECTIONS = 3, 20
_RELATIVE_ERRORS = (1e-4, 0.2)  # between which the truth lies
_MEDIAN_CHI2 = 0.4549  # median of chi-square with one degree of freedom

_CHUNK = 512  # pixels a thread takes at a time: small enough to balance, large enough not to matter


@dataclass(frozen=True)
class PixelFits:
    """Fits of P pixels in C channels.

    Attributes
    ----------
    normals : ndarray, shape (P, 3)
        NaN = not solved.
    covariance : ndarray, shape (P, 3)
        xx, xy, yy of the two tangent parameters, rad^2.
    reduced_chi2 : ndarray, shape (P,)
    atom : ndarray of int16, shape (P, C, MAX_ATOMS)
        Index into the dictionary; -1 = none.
    coefficient : ndarray, shape (P, C, MAX_ATOMS)
        Non-negative; times the atom in 1/sr and summed over the atoms it gives the BRDF.
    flags : ndarray of uint8, shape (P,)
        Bits of `analysis.pixel_solver`.
    theta_h_range : ndarray, shape (P, 2)
        Smallest and largest half angle seen, rad.
    dictionary : Dictionary
    """

    normals: Array
    covariance: Array
    reduced_chi2: Array
    atom: NDArray[np.int16]
    coefficient: Array
    flags: NDArray[np.uint8]
    theta_h_range: Array
    dictionary: Dictionary

    def select(self, pixels: NDArray[np.int64]) -> PixelFits:
        """Return the fits of these pixels only."""
        return PixelFits(
            normals=self.normals[pixels],
            covariance=self.covariance[pixels],
            reduced_chi2=self.reduced_chi2[pixels],
            atom=self.atom[pixels],
            coefficient=self.coefficient[pixels],
            flags=self.flags[pixels],
            theta_h_range=self.theta_h_range[pixels],
            dictionary=self.dictionary,
        )

    @property
    def normal_sigma(self) -> Array:
        """Standard deviation per tangent axis, rad: root of half the trace of the covariance."""
        return np.asarray(np.sqrt(0.5 * (self.covariance[:, 0] + self.covariance[:, 2])))

    def brdf(self, cosines: Cosines) -> Array:
        """Return the BRDF of each pixel in 1/sr, shape (P, ..., C), at `cosines` of shape (P, ...)."""
        shape = cosines.n_dot_h.shape
        value = np.zeros((*shape, self.atom.shape[1]))
        for k in np.unique(self.atom[self.atom >= 0]):
            weight = np.sum(np.where(self.atom == k, self.coefficient, 0.0), axis=-1)
            users = np.flatnonzero(weight.any(axis=1))
            atom = self.dictionary.atoms[k]
            part = Cosines(cosines.n_dot_h[users], cosines.cos_d[users], cosines.n_dot_l[users], cosines.n_dot_v[users])
            curve = MODELS[atom.model](part, atom.a, atom.b)
            value[users] += curve[..., None] * weight[users].reshape(len(users), *(1,) * (len(shape) - 1), -1)
        return value

    def radiance(self, points: Array, camera: Array, light: Array, light_power: float = 1.0) -> Array:
        """Predict what a view shows, shape (P, C), in the stack's units.

        radiance = P / d^2 f(omega_i, omega_o) max(0, n.omega_i), without cast shadows.

        Parameters
        ----------
        points : ndarray, shape (P, 3)
        camera, light : ndarray, shape (3,)
            Sample frame, mm.
        """
        to_light, to_camera = light - points, camera - points
        d2 = np.sum(to_light**2, axis=-1)
        omega_i = to_light / np.sqrt(d2)[:, None]
        omega_o = to_camera / np.linalg.norm(to_camera, axis=-1, keepdims=True)
        n_dot_l = np.sum(self.normals * omega_i, axis=-1)
        n_dot_v = np.sum(self.normals * omega_o, axis=-1)
        with np.errstate(invalid="ignore"):
            lit = np.where((n_dot_l > 0.0) & (n_dot_v > 0.0), n_dot_l, np.where(np.isnan(n_dot_l), np.nan, 0.0))
        f = self.brdf(Cosines.from_directions(self.normals, omega_i, omega_o))
        return np.asarray(light_power * f * (lit / d2)[:, None])


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
    """

    def __init__(
        self,
        stack: Stack,
        dictionary: Dictionary,
        pixels: NDArray[np.int64] | None = None,
        depth: Array | None = None,
    ) -> None:
        n, height, width, n_channels = stack.radiance.shape
        self.dictionary = dictionary
        self.pixels = np.arange(height * width) if pixels is None else pixels
        self.stack = stack
        z = None if depth is None else np.nan_to_num(depth)
        self.points = stack.grid.points(z).reshape(-1, 3)[self.pixels]

        def flat(a: NDArray[np.float32] | None, default: float) -> NDArray[np.float32]:
            if a is None:
                # One value seen from everywhere: no memory for what was not measured.
                return np.broadcast_to(np.float32(default), (n, len(self.pixels), n_channels)).astype(np.float32)
            a = a.reshape(n, height * width, n_channels)
            return np.ascontiguousarray(a if pixels is None else a[:, pixels])

        saturated = None if stack.saturated is None else stack.saturated.reshape(n, height * width, n_channels)
        # Contiguous all, since numba compiles the solver anew for every other layout.
        self.samples = Samples(
            flat(stack.radiance, 0.0),
            flat(stack.variance, 0.0),
            np.zeros((n, len(self.pixels), n_channels), np.uint8)
            if saturated is None
            else np.ascontiguousarray(saturated[:, self.pixels]),
        )

    def solve(
        self,
        noise: Noise,
        *,
        start: Array | None = None,
        light_position: Array | None = None,
        tolerance: float = 2.0,
        robust: bool = True,
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
        threads : int or None
            None = all processors; the result does not depend on it.
        """
        n_pixels, n_channels = self.samples.radiance.shape[1:]
        light = self.stack.light_position if light_position is None else light_position
        geometry = Geometry(
            self.stack.camera_position,
            np.ascontiguousarray(light),
            self.stack.light_power,
            self.points,
            np.full((n_pixels, 3), np.nan) if start is None else start,
        )
        settings = Settings(noise.relative, noise.floor, tolerance, robust)
        table = self.dictionary.slice_table()
        out = Solution(
            np.empty((n_pixels, 3)),
            np.empty((n_pixels, 3)),
            np.empty(n_pixels),
            np.empty((n_pixels, n_channels, MAX_ATOMS), np.int16),
            np.empty((n_pixels, n_channels, MAX_ATOMS)),
            np.zeros(n_pixels, np.uint8),
            np.empty((n_pixels, 2)),
        )

        def chunk(first: int) -> None:
            last = min(first + _CHUNK, n_pixels)
            pixel_solver.solve_pixels(self.samples, geometry, settings, table.value, table.derivative, first, last, out)

        with ThreadPoolExecutor(threads or n_threads()) as pool:
            list(pool.map(chunk, range(0, n_pixels, _CHUNK)))
        return self._fits(out, table.scale)

    def model(self, fits: PixelFits) -> Array:
        """Return what `fits` say of every sample, shape (N, P, C), on the slice theta_d = 0 as they were fitted."""
        to_light = self.stack.light_position - self.points[:, None]
        to_camera = self.stack.camera_position - self.points[:, None]
        d2 = np.sum(to_light**2, axis=-1)
        omega_i = to_light / np.sqrt(d2)[..., None]
        h = omega_i + to_camera / np.linalg.norm(to_camera, axis=-1, keepdims=True)
        h /= np.linalg.norm(h, axis=-1, keepdims=True)
        normals = fits.normals[:, None]
        n_dot_l = np.maximum(np.sum(normals * omega_i, axis=-1), 0.0)
        n_dot_h = np.clip(np.sum(normals * h, axis=-1), GRAZING, 1.0)
        f = fits.brdf(Cosines(n_dot_h, np.ones_like(n_dot_h), n_dot_h, n_dot_h))
        return np.moveaxis(f * (self.stack.light_power * n_dot_l / d2)[..., None], 1, 0)

    def _fits(self, out: Solution, scale: Array) -> PixelFits:
        low, high = out.n_dot_h_range[:, 0], out.n_dot_h_range[:, 1]
        return PixelFits(
            normals=out.normal,
            covariance=out.covariance,
            reduced_chi2=out.reduced_chi2,
            atom=out.atom,
            coefficient=out.coefficient / scale[np.maximum(out.atom, 0)],
            flags=out.flags,
            theta_h_range=np.arccos(np.clip(np.stack([high, low], axis=1), -1.0, 1.0)),
            dictionary=self.dictionary,
        )


def sample_pixels(stack: Stack, n_pixels: int, rng: np.random.Generator) -> NDArray[np.int64]:
    """Draw at most `n_pixels` pixels that enough views see, in ascending order."""
    seen = np.isfinite(stack.radiance).all(axis=-1).sum(axis=0).ravel()
    candidates = np.flatnonzero(seen >= min(pixel_solver.MIN_VIEWS, stack.n_views))
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
    level = float(np.nanmedian(np.abs(stack.radiance)))
    # Without a stated variance something must hold up the dark samples: a thousandth of the typical radiance.
    floor = (1e-3 if stack.variance is None else 1e-5) * level
    problem = PixelProblem(stack, dictionary, sample_pixels(stack, 600, rng))
    noise = Noise(0.01, floor)
    for _ in range(_NOISE_ROUNDS):
        fits = problem.solve(noise)
        if not np.isfinite(fits.reduced_chi2).any():
            return noise
        noise = replace(noise, relative=_relative_error(problem, fits, floor))
    return noise


def _relative_error(problem: PixelProblem, fits: PixelFits, floor: float) -> float:
    """Return the relative error at which the median of r^2 / (variance + (relative error m)^2) is a Gaussian's."""
    samples, model = problem.samples, problem.model(fits)
    valid = np.isfinite(samples.radiance) & np.isfinite(model) & (samples.saturated == 0)
    n_samples = valid.sum(axis=(0, 2))
    n_unknowns = 2 + np.count_nonzero(fits.atom >= 0, axis=(1, 2))
    # What the fit took out of the residuals.
    left = np.maximum(n_samples - n_unknowns, 1) / np.maximum(n_samples, 1)
    r2 = ((samples.radiance - model) ** 2 / left[:, None])[valid]
    base, m2 = samples.variance[valid].astype(np.float64) + floor**2, model[valid] ** 2
    low, high = _RELATIVE_ERRORS
    for _ in range(_BISECTIONS):
        middle = float(np.sqrt(low * high))
        too_low = np.median(r2 / (base + middle**2 * m2)) > _MEDIAN_CHI2
        low, high = (middle, high) if too_low else (low, middle)
    return float(np.sqrt(low * high))
