"""Which points of a relief the relief itself hides from a camera or a light."""

from __future__ import annotations

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

from analysis.registration.grid import Grid

Array = NDArray[np.float64]

_CLEARANCE = 0.1
"""How far, in grid pixels, something must stand above the line of sight to cut it: depth is known no better."""


def hidden(depth: Array, grid: Grid, position: Array) -> NDArray[np.bool_]:
    """Tell which points cannot be seen from `position`, shape (height, width).

    Parameters
    ----------
    depth : ndarray, shape (height, width)
        Height z of the surface on the grid, mm. Where it is NaN nothing hides and nothing is hidden.
    grid : Grid
    position : ndarray, shape (3,)
        Of the camera or the light, sample frame, mm.

    Raises
    ------
    ValueError
        If the depth does not lie on the grid, or the position is not above the surface.
    """
    if depth.shape != (grid.height, grid.width):
        raise ValueError(f"depth is {depth.shape}; on this grid it is {(grid.height, grid.width)}.")
    top = float(np.nanmax(depth, initial=-np.inf))
    if not position[2] > top:
        raise ValueError(f"position is {position} mm; it must stand above the surface, whose top is at {top:g} mm.")
    x = position[0] / grid.pitch + (grid.width - 1) / 2
    y = (grid.height - 1) / 2 - position[1] / grid.pitch
    in_pixels = np.ascontiguousarray(depth / grid.pitch, np.float64)
    return _hidden(in_pixels, top / grid.pitch, float(x), float(y), float(position[2] / grid.pitch))


@njit(cache=True, nogil=True, parallel=True)
def _hidden(depth: Array, top: float, x: float, y: float, z: float) -> NDArray[np.bool_]:
    out = np.zeros(depth.shape, np.bool_)
    for i in prange(depth.shape[0]):
        for j in range(depth.shape[1]):
            out[i, j] = _cut(depth, i, j, top, x, y, z)
    return out


@njit(cache=True, nogil=True)
def _cut(depth: Array, i: int, j: int, top: float, x: float, y: float, z: float) -> bool:
    """March from a point towards (x, y, z), one pixel a step along the longer way, until above all of the relief."""
    height, width = depth.shape
    longer = max(abs(x - j), abs(y - i))
    if not longer > 0.0:
        return False
    right, down, up = (x - j) / longer, (y - i) / longer, (z - depth[i, j]) / longer
    for step in range(1, int(longer) + 1):
        line = depth[i, j] + step * up
        u, v = j + step * right, i + step * down
        # Negated, so that a point without depth is hidden by nothing.
        if not (line < top and 0.0 <= u <= width - 1 and 0.0 <= v <= height - 1):
            return False
        if _between(depth, v, u) > line + _CLEARANCE:
            return True
    return False


@njit(cache=True, nogil=True)
def _between(depth: Array, v: float, u: float) -> float:
    """Interpolate between four pixels, linearly; one of two coordinates is whole up to rounding."""
    i, j = min(int(v), depth.shape[0] - 2), min(int(u), depth.shape[1] - 2)
    b, a = v - i, u - j
    above = (1.0 - a) * depth[i, j] + a * depth[i, j + 1]
    below = (1.0 - a) * depth[i + 1, j] + a * depth[i + 1, j + 1]
    return float((1.0 - b) * above + b * below)
