"""Heights of the scenes as smooth functions of x and y, for an area 60 mm wide; others are scaled.

Everything is smooth: bicubic tables of it are then as good as the formula.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

DESIGN_WIDTH_MM = 60.0

# The letter F as boxes (left, right, bottom, top) in mm: unlike its mirror image, and not symmetric.
_LETTER_F = ((5.0, 9.5, 2.0, 25.0), (5.0, 22.0, 20.5, 25.0), (5.0, 18.0, 11.0, 15.5))

_EDGE_MM = 0.65

_LETTER_HEIGHT_MM = 0.55


def sigmoid(x: Array) -> Array:
    """Return the logistic function, written with tanh so that it cannot overflow."""
    return 0.5 * (1.0 + np.tanh(0.5 * x))


def _embossed_letter(x: Array, y: Array) -> Array:
    outside = np.ones(np.broadcast_shapes(x.shape, y.shape))
    width = 0.5 * _EDGE_MM
    for left, right, bottom, top in _LETTER_F:
        across = sigmoid((x - left) / width) * sigmoid((right - x) / width)
        along = sigmoid((y - bottom) / width) * sigmoid((top - y) / width)
        outside *= 1.0 - across * along
    return _LETTER_HEIGHT_MM * (1.0 - outside)


def _rings(x: Array, y: Array) -> Array:
    r2 = (x + 14.0) ** 2 + (y - 11.0) ** 2
    return 0.36 * np.cos(2.0 * np.pi / 7.0 * np.sqrt(r2)) * np.exp(-r2 / 13.0**2)


def _dimples(x: Array, y: Array) -> Array:
    r2 = (x + 14.0) ** 2 + (y + 15.0) ** 2
    lattice = np.cos(2.0 * np.pi / 6.5 * x) * np.cos(2.0 * np.pi / 6.5 * y)
    return -0.34 * lattice * np.exp(-((r2 / 12.0**2) ** 2))


def _ripples(x: Array, y: Array) -> Array:
    r2 = (x - 15.0) ** 2 + (y + 15.0) ** 2
    phase = 2.0 * np.pi / 9.0 * (0.8 * x + 0.6 * y + 0.02 * y * y)
    return 0.38 * np.sin(phase) * np.exp(-((r2 / 13.0**2) ** 2))


def _undulation(x: Array, y: Array) -> Array:
    return 0.16 * np.sin(2.0 * np.pi * x / 47.0 + 0.5) * np.cos(2.0 * np.pi * y / 39.0 - 0.3)


def relief(x: Array, y: Array) -> Array:
    """Return an embossed F (upper right), rings, dimples and ripples on a gentle undulation, mm."""
    return _embossed_letter(x, y) + _rings(x, y) + _dimples(x, y) + _ripples(x, y) + _undulation(x, y) - 0.1


def plane(x: Array, y: Array) -> Array:
    """Return 0 everywhere."""
    return np.zeros(np.broadcast_shapes(x.shape, y.shape))


def sphere_cap(x: Array, y: Array) -> Array:
    """Return a cap of radius 120 mm that rises from a circle of radius 24 mm, its foot rounded off, mm."""
    R, foot, rounding = 120.0, 24.0, 0.15
    cap = np.sqrt(R * R - x * x - y * y) - np.sqrt(R * R - foot * foot)
    rounded: Array = rounding * np.logaddexp(0.0, cap / rounding)
    return rounded


HEIGHTS = {"relief": relief, "plane": plane, "sphere_cap": sphere_cap}


def _fade(u: Array, half_width: float) -> Array:
    # Quintic, so that slope and curvature also vanish where the insert meets the plate.
    t = np.clip((half_width - 0.5 - np.abs(u)) / 4.5, 0.0, 1.0)
    return t * t * t * (t * (6.0 * t - 15.0) + 10.0)


def insert_heights(scene: str, half_widths: tuple[float, float], x: Array, y: Array) -> Array:
    """Return the heights of a scene's insert in mm, going smoothly to 0 at its border.

    Parameters
    ----------
    scene : str
        A key of `HEIGHTS`.
    half_widths : tuple of float
        Half the width and height of the insert, mm.
    x, y : ndarray
        Points in the sample frame, mm; they broadcast.
    """
    # Heights shrink with the widths: slopes stay what they are.
    scale = design_scale(half_widths)
    fade = _fade(x, half_widths[0]) * _fade(y, half_widths[1])
    return scale * HEIGHTS[scene](x / scale, y / scale) * fade


def design_scale(half_widths: tuple[float, float]) -> float:
    """Return how much larger an insert is than the one the shapes were drawn for."""
    return min(half_widths) / (0.5 * DESIGN_WIDTH_MM + 2.0)
