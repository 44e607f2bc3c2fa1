"""A height map as a bicubic spline: heights and slopes come from one function, so they agree exactly."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import spline_filter

from drivers.simulated.rendering.compiling import njit

Array = NDArray[np.float64]

HeightFunction = Callable[[Array, Array], Array]

_PAD_MM = 1e-3


class HeightField(NamedTuple):
    """Heights over a square grid; 0 outside it. Node (j, i) lies at x0 + i pitch, y0 + j pitch.

    Attributes
    ----------
    coefficients : ndarray, shape (ny, nx)
        Of the cubic B-spline, mm.
    heights : ndarray, shape (ny, nx)
        At the nodes, mm.
    x0, y0, pitch : float
        Of the grid, mm.
    low, high : float
        Below and above every height, mm.
    """

    coefficients: Array
    heights: Array
    x0: float
    y0: float
    pitch: float
    low: float
    high: float


def grid_axis(half_width: float, pitch: float) -> Array:
    """Return nodes from about -half_width to half_width, symmetric about 0."""
    n = math.ceil(half_width / pitch)
    return np.arange(-n, n + 1, dtype=np.float64) * pitch


def sample_heights(
    function: HeightFunction, half_widths: tuple[float, float], pitch: float, spare: float = 2.0
) -> HeightField:
    """Tabulate `function` over the insert and `spare` mm round it, where it has to be 0.

    Parameters
    ----------
    function : callable
        Heights (mm) from x and y (mm).
    half_widths : tuple of float
        Half the width and height of the insert, mm.
    pitch : float
        Distance of the nodes, mm.
    spare : float
        Width of the flat border, mm; keeps the spline's own border away from the relief.
    """
    x, y = grid_axis(half_widths[0] + spare, pitch), grid_axis(half_widths[1] + spare, pitch)
    heights = np.ascontiguousarray(function(x[None, :], y[:, None]), dtype=np.float64)
    return HeightField(
        coefficients=spline_filter(heights, order=3, mode="mirror"),
        heights=heights,
        x0=float(x[0]),
        y0=float(y[0]),
        pitch=pitch,
        low=min(float(heights.min()), 0.0) - _PAD_MM,
        high=max(float(heights.max()), 0.0) + _PAD_MM,
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _basis(t: float, k: int) -> tuple[float, float]:
    """Return the k-th of the four cubic B-splines that reach a cell, at t in [0, 1), and its slope."""
    if k == 0:
        return (1.0 - t) ** 3 / 6.0, -0.5 * (1.0 - t) ** 2
    if k == 1:
        return (4.0 - 6.0 * t * t + 3.0 * t**3) / 6.0, 1.5 * t * t - 2.0 * t
    if k == 2:
        return (1.0 + 3.0 * t + 3.0 * t * t - 3.0 * t**3) / 6.0, 0.5 + t - 1.5 * t * t
    return t**3 / 6.0, 0.5 * t * t


@njit(cache=True, nogil=True, error_model="numpy")
def height_and_slope(field: HeightField, x: float, y: float) -> tuple[float, float, float]:
    """Return height (mm), dz/dx and dz/dy at a point, from the cubic B-spline."""
    u, v = (x - field.x0) / field.pitch, (y - field.y0) / field.pitch
    ny, nx = field.coefficients.shape
    if not (u >= 1.0 and v >= 1.0 and u < nx - 2 and v < ny - 2):
        return 0.0, 0.0, 0.0
    i, j = int(u), int(v)
    s, t = u - i, v - j
    (b0, d0), (b1, d1), (b2, d2), (b3, d3) = _basis(s, 0), _basis(s, 1), _basis(s, 2), _basis(s, 3)
    z = z_u = z_v = 0.0
    c = field.coefficients
    for k in range(4):
        m = j - 1 + k
        row = b0 * c[m, i - 1] + b1 * c[m, i] + b2 * c[m, i + 1] + b3 * c[m, i + 2]
        slope = d0 * c[m, i - 1] + d1 * c[m, i] + d2 * c[m, i + 1] + d3 * c[m, i + 2]
        b, d = _basis(t, k)
        z += b * row
        z_u += b * slope
        z_v += d * row
    return z, z_u / field.pitch, z_v / field.pitch


@njit(cache=True, nogil=True, error_model="numpy")
def rough_height(field: HeightField, x: float, y: float) -> float:
    """Return the height by bilinear interpolation: good to some um, and four times as fast."""
    u, v = (x - field.x0) / field.pitch, (y - field.y0) / field.pitch
    ny, nx = field.heights.shape
    if not (u >= 0.0 and v >= 0.0 and u < nx - 1 and v < ny - 1):
        return 0.0
    i, j = int(u), int(v)
    s, t = u - i, v - j
    below = field.heights[j, i] * (1.0 - s) + field.heights[j, i + 1] * s
    above = field.heights[j + 1, i] * (1.0 - s) + field.heights[j + 1, i + 1] * s
    return float(below * (1.0 - t) + above * t)


@njit(cache=True, nogil=True, error_model="numpy")
def heights_and_slopes(field: HeightField, x: Array, y: Array) -> Array:
    """Return height, dz/dx and dz/dy, shape (n, 3), at the points `x`, `y` of shape (n,)."""
    out = np.empty((x.size, 3))
    for k in range(x.size):
        out[k, 0], out[k, 1], out[k, 2] = height_and_slope(field, x[k], y[k])
    return out
