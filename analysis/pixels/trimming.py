"""Samples that no highlight and no shadow is in, for a Lambertian fit: those of middling brightness of each pixel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.pixels.problem import Noise, PixelProblem, sample_pixels
from analysis.pixels.samples import MIN_VIEWS
from analysis.reflectance.dictionary import lambertian
from analysis.registration.stack import Stack

KEPT = (0.2, 0.6)
"""Quantiles of a pixel's brightness between which its views are kept: shadows and what is near them lie below,
highlights with their long tails above. Residuals of a fit to all cannot tell as much once a third is wrong."""

SKEWED = 0.3
"""Skewness of the residuals from which on there are highlights: 0.02 of a matte surface, 0.9 of a glossy one."""

_N_PIXELS, _TAILS, _NOISE = 1000, (0.05, 0.5, 0.95), Noise(0.02, 1e-9)

_SPARE = 2  # views beyond those that a solver needs


def without_highlights(stack: Stack) -> Stack:
    """Return the stack with the samples taken out that are not of middling brightness in their pixel's views.

    With few views more of them are kept, so that a pixel can be solved. A surface without highlights, whose residuals
    are as far below a Lambertian fit as above, keeps all: each that is taken out would cost accuracy.
    """
    if skewness(stack) < SKEWED:
        return stack
    brightness = np.stack([np.asarray(view).mean(axis=-1) for view in stack.radiance]).astype(np.float64)
    # As the pixel would be lit at one distance and power: of another view, not of a stronger light.
    distance2 = np.sum(stack.light_position**2, axis=1)
    brightness *= (distance2 / np.where(np.isfinite(stack.light_power), stack.light_power, np.nan))[:, None, None]
    rank = np.where(np.isfinite(brightness), brightness, np.inf).argsort(axis=0).argsort(axis=0)
    n_seen = np.isfinite(brightness).sum(axis=0)
    low = np.floor(KEPT[0] * n_seen)
    high = np.maximum(np.ceil(KEPT[1] * n_seen), np.minimum(low + MIN_VIEWS + _SPARE, n_seen))
    low = np.minimum(low, np.maximum(n_seen - MIN_VIEWS - _SPARE, 0))
    kept = (rank >= low) & (rank < high)
    return replace(stack, radiance=np.where(kept[..., None], np.asarray(stack.radiance), np.nan).astype(np.float32))


def skewness(stack: Stack) -> float:
    """Return Bowley's skewness of the relative residuals of a Lambertian fit, on their tails: 0 = as far up as down.

    (q_95 + q_5 - 2 q_50) / (q_95 - q_5), with plain least squares, which highlights pull but do not hide from.
    """
    pixels = sample_pixels(stack, _N_PIXELS, np.random.default_rng(0))
    problem = PixelProblem(stack, lambertian(), pixels)
    model = problem.model(problem.solve(_NOISE, robust=False))
    level = np.abs(np.nan_to_num(model)).mean(axis=0, keepdims=True)
    with np.errstate(invalid="ignore", divide="ignore"):
        r = (problem.samples.radiance - model) / level
    r = r[np.isfinite(r) & (problem.samples.saturated == 0)]
    if r.size == 0:
        return 0.0
    low, middle, high = np.quantile(r, _TAILS)
    return float((high + low - 2.0 * middle) / (high - low)) if high > low else 0.0
