"""Integration that lets the surface step: pairs that contradict the rest lose their weight.

Iteratively reweighted least squares with the Geman-McClure weight of a pair's residual r = (z_b - z_a - g) / pitch,

    w = (1 + (r / c)^2)^-2 ,

which nears 0 where the slopes on either side of a pair agree with their own side only, as at an edge whose face
the camera does not see. c starts wide, so that the first weights follow from the residuals as a whole, and
narrows [black1996]; a smooth surface, whose residuals are noise, keeps its weights. A closed step with flat
ground on both sides leaves no trace in the normals, and no method finds it. One-sided weights in the manner of
[cao2022] were tried and left more of the step behind (docs/decisions/0008). Right at a step the few nearest pixels
may stay between its two sides.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.depth.multigrid import PairSystem

Array = NDArray[np.float64]

SMALLEST_SCALE = 0.02
"""Residual slope below which a pair is never doubted: what discretization leaves on a smooth surface."""

NOISE_SCALES = 4.0
"""A pair is doubted beyond so many robust standard deviations of all residuals."""

NARROWING = 0.6

MAX_ROUNDS = 40

SMALLEST_WEIGHT = 1e-7
"""What a step keeps. Its residual slope may be a hundred, and a thousandth of a slope is still a pull on both sides."""

STILL = 1e-3
"""The surface has settled when no pixel moves by more of its span."""

LOOSE = 1e-2
"""Each round continues from the last one's heights; its own accuracy need not be final."""


def solve_robustly(
    g_x: Array,
    g_y: Array,
    w_x: Array,
    w_y: Array,
    t: Array,
    h: Array,
    pitch: float,
    tolerance: float,
) -> Array:
    """Return heights, shape (height, width), in mm.

    Parameters
    ----------
    g_x, g_y, w_x, w_y : ndarray, shape (height, width)
        Increments in mm and weights of the pairs to the right and below; weight 0 in the last column, or row.
    t, h : ndarray, shape (height, width)
        Weights of known heights, and these heights in mm; 0 and any number where none is known.
    pitch : float
        Millimetres.
    tolerance : float
        Of the first solution; the rounds have `LOOSE`.
    """
    z = _solved(np.zeros_like(t), g_x, g_y, w_x, w_y, t, h, tolerance)
    scale, narrowest = np.inf, 0.0
    for _ in range(MAX_ROUNDS):
        r_x, r_y = _residuals(z, g_x, w_x, pitch), _residuals(z.T, g_y.T, w_y.T, pitch).T
        size = np.concatenate([r_x[w_x > 0.0], r_y[w_y > 0.0]])
        if size.size == 0:
            break
        narrowest = max(SMALLEST_SCALE, NOISE_SCALES * 1.4826 * float(np.median(size)))
        scale = max(NARROWING * min(scale, float(size.max())), narrowest)
        moved = _solved(z, g_x, g_y, w_x * _kept(r_x, scale), w_y * _kept(r_y, scale), t, h, LOOSE)
        change, z = float(np.abs(moved - z).max()), moved
        if scale <= narrowest and change <= STILL * float(np.ptp(z)):
            break
    return z


def _kept(r: Array, scale: float) -> Array:
    return np.asarray(np.maximum((1.0 + (r / scale) ** 2) ** -2, SMALLEST_WEIGHT))


def _residuals(z: Array, g: Array, w: Array, pitch: float) -> Array:
    """Return the sizes of the residual slopes of pairs along rows, 0 where there is no pair."""
    return np.asarray(np.where(w > 0.0, np.abs(np.diff(z, axis=1, append=z[:, -1:]) - g), 0.0) / pitch)


def _solved(z: Array, g_x: Array, g_y: Array, w_x: Array, w_y: Array, t: Array, h: Array, tolerance: float) -> Array:
    """Go on from `z` to the heights that fit these weights."""
    system = PairSystem(w_x, w_y, t)
    return np.asarray(z + system.solve(system.residual(z, system.right_side(g_x, g_y, h)), tolerance))
