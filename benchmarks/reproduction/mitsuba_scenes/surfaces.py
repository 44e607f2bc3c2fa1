"""Heights of the rendered scenes as functions of x and y (mm), and the truth that follows from them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

Heights = Callable[[Array, Array], Array]

HALF_WIDTH_MM = 24.0
"""Half the side of the square of relief; it goes smoothly to the plate's height 0 at its border."""

_FADE_MM = 3.0

_STEP_MM = 1e-4  # of the central differences: their error, some 1e-9, is nothing here


@dataclass(frozen=True)
class Surface:
    """A relief over the plate z = 0.

    Attributes
    ----------
    shape : callable
        Heights (mm) from x and y (mm), before they fade out at the border.
    """

    shape: Heights

    def height(self, x: Array, y: Array) -> Array:
        """Return the height over the plate, mm, at points that broadcast."""
        return self.shape(x, y) * _fade(x) * _fade(y)

    def normals(self, x: Array, y: Array) -> Array:
        """Return the unit normals, last axis 3, at points that broadcast."""
        x, y = np.broadcast_arrays(x, y)
        slope_x = (self.height(x + _STEP_MM, y) - self.height(x - _STEP_MM, y)) / (2.0 * _STEP_MM)
        slope_y = (self.height(x, y + _STEP_MM) - self.height(x, y - _STEP_MM)) / (2.0 * _STEP_MM)
        normals = np.stack([-slope_x, -slope_y, np.ones_like(slope_x)], axis=-1)
        return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))


def _fade(u: Array) -> Array:
    # Quintic, so that slope and curvature also vanish where the relief meets the plate.
    t = np.clip((HALF_WIDTH_MM - 0.5 - np.abs(u)) / _FADE_MM, 0.0, 1.0)
    return t * t * t * (t * (6.0 * t - 15.0) + 10.0)


def medal(x: Array, y: Array) -> Array:
    """Return a struck medal: a rim, a star in its middle, a milled band and a field that is not quite even."""
    r, phi = np.hypot(x, y), np.arctan2(y, x)
    rim = 0.5 * np.exp(-(((r - 19.0) / 1.6) ** 2))
    edge = 9.0 + 2.2 * np.cos(5.0 * (phi - 0.4))
    star = 0.45 * (1.0 - np.tanh((r - edge) / 0.8)) + 0.35 * np.exp(-((r / 4.0) ** 2))
    milled = 0.06 * np.cos(48.0 * phi) * np.exp(-(((r - 14.8) / 1.3) ** 2))
    field = 0.12 * np.sin(x / 6.0 + 0.5) * np.cos(y / 5.0)
    return np.asarray(rim + star + milled + field)


def leaf(x: Array, y: Array) -> Array:
    """Return a leaf's underside: a midrib, side veins that branch off it, and a blade that bulges between them."""
    midrib = 0.7 * np.exp(-((y / 1.4) ** 2))
    # The kink of the absolute value lies where the side veins have height and slope 0.
    along = x - 0.9 * np.abs(y)
    veins = 0.28 * np.exp(3.5 * (np.cos(2.0 * np.pi * along / 8.5) - 1.0)) * (1.0 - np.exp(-((y / 2.0) ** 2)))
    blade = 0.4 * np.cos(x / 9.0 + 0.3) * np.sin(y / 7.0)
    grain = 0.02 * np.sin(2.0 * np.pi * (x + 0.3 * y) / 2.1) * np.sin(2.0 * np.pi * (y - 0.2 * x) / 2.4)
    return np.asarray(midrib + veins + blade + grain)


def weave(x: Array, y: Array) -> Array:
    """Return a plain weave of threads 4 mm apart on a cloth that is not quite flat."""
    u, v = 2.0 * np.pi * x / 8.0, 2.0 * np.pi * y / 8.0
    over = 0.28 * np.sin(u) * np.sin(v)
    threads = 0.05 * (np.cos(2.0 * u) + np.cos(2.0 * v))
    folds = 0.5 * np.exp(-(((x + 0.6 * y - 4.0) / 6.0) ** 2)) + 0.15 * np.sin(x / 8.0 - y / 11.0)
    return np.asarray(over + threads + folds)
