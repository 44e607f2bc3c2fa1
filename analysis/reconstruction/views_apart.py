"""Whether parts of the views say the same of a normal: what a model's error does that no residual shows.

A curve that is not quite the material's, or a BRDF that is not quite reciprocal, bends normals as the views pull on
them: another way when some are missing. Views are cut into blocks by azimuth and by tilt, each block is left out in
turn, and the scatter of the normals (the jackknife's [efron1982]) is held against the stated variance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.fits import PixelFits
from analysis.registration.stack import Stack

Array = NDArray[np.float64]

Labels = NDArray[np.int64]

Solve = Callable[[Stack, Labels, Array], PixelFits]

MIN_VIEWS = 15
"""Fewer are not cut into blocks: what is left of them would not determine a normal."""

N_BLOCKS, N_PIXELS = 5, 400

EXPECTED = 1.4
"""Ratio where the model is right: blocks are no small change. Simulated reliefs of 25 and 65 views have 1.1 to 1.6,
those of measured materials 2.7 to 4.2."""


def variance_ratio(stack: Stack, fits: PixelFits, solve: Solve, rng: np.random.Generator) -> float:
    """Return by how much the variance of the normals is larger than stated, at least 1.

    Parameters
    ----------
    stack : Stack
        With `MIN_VIEWS` views and more.
    fits : PixelFits
        Of all pixels.
    solve : callable
        Solves some pixels of a stack, given by flat indices, from normals of shape (P, 3).
    rng : numpy.random.Generator
        Draws the pixels.
    """
    solved = np.flatnonzero(np.isfinite(fits.normals[:, 0]))
    if len(solved) == 0:
        return 1.0
    pixels = np.sort(rng.permutation(solved)[:N_PIXELS])
    whole = solve(stack, pixels, fits.normals[pixels])
    omega = stack.light_position / np.linalg.norm(stack.light_position, axis=1, keepdims=True)
    ratios = [_ratio(stack, whole, solve, pixels, key) for key in (np.arctan2(omega[:, 1], omega[:, 0]), omega[:, 2])]
    return max(1.0, *ratios)


def _ratio(stack: Stack, whole: PixelFits, solve: Solve, pixels: Labels, key: Array) -> float:
    block = key.argsort().argsort() * N_BLOCKS // stack.n_views
    moved = []
    for k in range(N_BLOCKS):
        power = np.where(block == k, np.nan, stack.light_power)
        moved.append(solve(replace(stack, light_power=power), pixels, whole.normals).normals - whole.normals)
    scatter = (N_BLOCKS - 1) * np.var(np.stack(moved), axis=0).sum(axis=-1)
    # The squared length of two Gaussian components has the median 2 log 2 times the variance of each.
    ratio = scatter / (2.0 * np.log(2.0) * whole.normal_sigma**2)
    return float(np.nanmedian(ratio)) / EXPECTED if np.isfinite(ratio).any() else 1.0
