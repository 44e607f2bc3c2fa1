"""Where camera and light stand for one picture, and what lens and light do to its brightness."""

from __future__ import annotations

import math
from typing import NamedTuple

from drivers.simulated.rendering.compiling import njit

Vector = tuple[float, float, float]

_UNDISTORT_STEPS = 5


class View(NamedTuple):
    """One picture to take; positions and axes in the sample frame, mm.

    Attributes
    ----------
    camera, light : tuple of float
        Where they are.
    right, down, forward : tuple of float
        The camera's axes as unit vectors.
    intrinsics : tuple of float
        fx, fy, cx, cy in pixels, k1, k2.
    vignetting, corner_radius : float
        Share lost at the corner, and how far that is from the principal point in pixels.
    lobe_exponent : float
        The light shines as cos^m about `forward`.
    """

    # Tuples, not arrays: the kernels would count references to arrays at every ray.
    camera: Vector
    light: Vector
    right: Vector
    down: Vector
    forward: Vector
    intrinsics: tuple[float, float, float, float, float, float]
    vignetting: float
    corner_radius: float
    lobe_exponent: float


@njit(cache=True, nogil=True, error_model="numpy")
def ray(view: View, u: float, v: float) -> Vector:
    """Return the direction (not of unit length) of the ray through pixel (u, v)."""
    fx, fy, cx, cy, k1, k2 = view.intrinsics
    x_d, y_d = (u - cx) / fx, (v - cy) / fy
    x, y = x_d, y_d
    for _ in range(_UNDISTORT_STEPS):
        r2 = x * x + y * y
        stretch = 1.0 + r2 * (k1 + r2 * k2)
        x, y = x_d / stretch, y_d / stretch
    right, down, forward = view.right, view.down, view.forward
    return (
        x * right[0] + y * down[0] + forward[0],
        x * right[1] + y * down[1] + forward[1],
        x * right[2] + y * down[2] + forward[2],
    )


@njit(cache=True, nogil=True, error_model="numpy")
def lobe(view: View, x: float, y: float, z: float) -> float:
    """Return cos^m of the angle between the light's axis and the way to a point."""
    to_x, to_y, to_z = x - view.light[0], y - view.light[1], z - view.light[2]
    fx, fy, fz = view.forward
    cosine = (to_x * fx + to_y * fy + to_z * fz) / math.sqrt(to_x * to_x + to_y * to_y + to_z * to_z)
    return float(max(0.0, cosine) ** view.lobe_exponent)


@njit(cache=True, nogil=True, error_model="numpy")
def transmission(view: View, u: float, v: float) -> float:
    """Return the share of the light that vignetting leaves at pixel (u, v)."""
    radius = math.hypot(u - view.intrinsics[2], v - view.intrinsics[3]) / view.corner_radius
    return max(0.0, 1.0 - view.vignetting * radius * radius)
