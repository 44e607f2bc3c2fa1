"""Error budget: how much each error of the calibration adds to the normals.

A sample of pixels is solved as it is, and again with one source disturbed by its stated standard deviation:
the change of the normals is what the source contributes. No linearisation, and no model of the errors
beside the one that states the sigmas.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.problem import Noise, PixelProblem, estimate_noise, sample_pixels, samples_of
from analysis.pixels.samples import Samples
from analysis.reflectance.dictionary import Dictionary, parametric
from analysis.registration.lighting import LightOffset, lit_from
from analysis.registration.stack import Stack

Array = NDArray[np.float64]

N_PIXELS, N_DRAWS = 300, 6

SYSTEMATIC = ("light position", "fall-off")
"""Sources that all views share: no residual shows them, so the noise found from residuals does not hold them."""


@dataclass(frozen=True, slots=True)
class ErrorBudget:
    """Contributions to the normal, degrees per tangent axis (RMS over the median half of the pixels).

    Attributes
    ----------
    contributions : dict
        By source: ``image noise``, ``light power``, ``light position``, ``registration``, ``fall-off``.
    """

    contributions: dict[str, float]

    @property
    def dominant(self) -> str:
        """The largest source."""
        return max(self.contributions, key=lambda name: self.contributions[name])

    @property
    def systematic(self) -> float:
        """What no residual shows, degrees per tangent axis."""
        return float(np.sqrt(sum(self.contributions.get(name, 0.0) ** 2 for name in SYSTEMATIC)))


def error_budget(
    stack: Stack, dictionary: Dictionary, noise: Noise, rng: np.random.Generator, depth: Array | None = None
) -> ErrorBudget:
    """Let loose each source that the stack states a sigma of.

    Parameters
    ----------
    stack : Stack
    dictionary : Dictionary
    noise : Noise
        What the pixels are weighed with; the image noise let loose is that of `stack.variance` alone.
    rng : numpy.random.Generator
    depth : ndarray, shape (H, W), or None
        Millimetres; None = flat.
    """
    pixels = np.sort(sample_pixels(stack, N_PIXELS, rng))
    problem = PixelProblem(stack, dictionary, pixels, depth)
    start = problem.solve(noise).normals
    base = problem.solve(noise, start=start).normals
    spread: dict[str, float] = {}
    for name, disturb in _sources(stack, problem, pixels).items():
        turns = [_turn(base, disturb(rng).solve(noise, start=base).normals) for _ in range(N_DRAWS)]
        # Per tangent axis; the median over the pixels, since one that finds another minimum says nothing.
        spread[name] = float(np.rad2deg(np.nanmedian(np.sqrt(np.mean(np.square(turns), axis=0) / 2.0))))
    return ErrorBudget(spread)


def budget_of(stack: Stack) -> ErrorBudget:
    """Return the budget of a stack that has not been reconstructed yet: flat, on the default dictionary."""
    rng = np.random.default_rng(0)
    dictionary = parametric()
    return error_budget(stack, dictionary, estimate_noise(stack, dictionary, rng), rng)


Disturb = Callable[[np.random.Generator], PixelProblem]


def _sources(stack: Stack, problem: PixelProblem, pixels: NDArray[np.int64]) -> dict[str, Disturb]:
    found: dict[str, Disturb] = {}
    samples = problem.samples
    if stack.variance is not None:
        sigma = np.sqrt(np.maximum(samples.variance, 0.0))
        found["image noise"] = lambda rng: _with(problem, samples.radiance + sigma * rng.standard_normal(sigma.shape))
    if stack.light_power_sigma is not None:
        of_power = stack.light_power_sigma
        found["light power"] = lambda rng: _scaled(problem, (of_power * rng.standard_normal(len(of_power)))[:, None])
    if stack.light_offset is not None and stack.light_offset_sigma is not None and stack.camera_rotation is not None:
        here = LightOffset(stack.light_offset, np.nan_to_num(stack.light_offset_sigma, posinf=0.0))
        found["light position"] = lambda rng: _lit_from(
            problem, LightOffset(here.value + here.sigma * rng.standard_normal(3), here.sigma)
        )
    if stack.registration_sigma is not None and stack.grid.height > 2 and stack.grid.width > 2:
        slope_x, slope_y = _slopes(stack, pixels)
        of_shift = stack.registration_sigma
        found["registration"] = lambda rng: _shifted(problem, slope_x, slope_y, of_shift, rng)
    if stack.falloff_sigma is not None and stack.camera_rotation is not None:
        across = _across(stack, problem.points)
        of_falloff = stack.falloff_sigma
        found["fall-off"] = lambda rng: _scaled(problem, of_falloff * (across @ rng.standard_normal(2)))
    return found


def _with(problem: PixelProblem, radiance: NDArray[np.floating]) -> PixelProblem:
    """Return the problem with other radiances."""
    samples = Samples(radiance.astype(np.float32), problem.samples.variance, problem.samples.saturated)
    return PixelProblem(problem.stack, problem.dictionary, problem.pixels, _heights(problem), samples)


def _heights(problem: PixelProblem) -> Array:
    """Return a depth map that gives the problem's own pixels their heights."""
    depth = np.zeros(problem.stack.grid.height * problem.stack.grid.width)
    depth[problem.pixels] = problem.points[:, 2]
    return depth.reshape(problem.stack.grid.height, -1)


def _scaled(problem: PixelProblem, log_gain: Array) -> PixelProblem:
    """Return the problem with radiances times exp(log_gain), shape (N, P) or (N, 1)."""
    return _with(problem, problem.samples.radiance * np.exp(log_gain)[..., None])


def _lit_from(problem: PixelProblem, offset: LightOffset) -> PixelProblem:
    moved = lit_from(problem.stack, offset)
    return PixelProblem(moved, problem.dictionary, problem.pixels, _heights(problem), problem.samples)


def _slopes(stack: Stack, pixels: NDArray[np.int64]) -> tuple[Array, Array]:
    """Return the change of radiance per mm along x and y, each (N, P, C), by central differences."""
    grid = stack.grid
    i, j = np.divmod(pixels, grid.width)
    i, j = np.clip(i, 1, grid.height - 2), np.clip(j, 1, grid.width - 2)
    plain = replace(stack, followed=None)

    def at(di: int, dj: int) -> Array:
        return np.asarray(samples_of(plain, (i + di) * grid.width + j + dj).radiance, np.float64)

    return (at(0, 1) - at(0, -1)) / (2 * grid.pitch), (at(-1, 0) - at(1, 0)) / (2 * grid.pitch)


def _shifted(
    problem: PixelProblem, slope_x: Array, slope_y: Array, sigma: Array, rng: np.random.Generator
) -> PixelProblem:
    dx, dy = (sigma * rng.standard_normal(len(sigma)) for _ in range(2))
    change = slope_x * dx[:, None, None] + slope_y * dy[:, None, None]
    return _with(problem, problem.samples.radiance + np.nan_to_num(change))


def _across(stack: Stack, points: Array) -> Array:
    """Return how far each point lies off the centre in each camera's frame, 1 at the area's border, (N, P, 2)."""
    assert stack.camera_rotation is not None
    half = 0.5 * max(stack.grid.height, stack.grid.width) * stack.pixel_pitch
    return np.asarray(np.einsum("nij,pj->npi", stack.camera_rotation, points)[..., :2] / half)


def _turn(a: Array, b: Array) -> Array:
    """Return angles between unit vectors, rad, shape (P,)."""
    return np.asarray(2.0 * np.arcsin(np.clip(0.5 * np.linalg.norm(a - b, axis=1), 0.0, 1.0)))
