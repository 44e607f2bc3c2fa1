"""Rays against the height field: the first hit, and whether a light is in sight."""

from __future__ import annotations

import math

from drivers.simulated.rendering.compiling import njit
from drivers.simulated.rendering.heightfield import HeightField, height_and_slope, rough_height

_STEP_MM = 0.3

_NEWTON_STEPS = 3

# The march uses bilinear heights: this much above them is still the surface itself.
_BIAS_MM = 0.003


@njit(cache=True, nogil=True, error_model="numpy")
def _misses_field(field: HeightField, xa: float, ya: float, xb: float, yb: float) -> bool:
    ny, nx = field.heights.shape
    x1, y1 = field.x0 + (nx - 1) * field.pitch, field.y0 + (ny - 1) * field.pitch
    beside = max(xa, xb) < field.x0 or min(xa, xb) > x1
    return beside or max(ya, yb) < field.y0 or min(ya, yb) > y1


@njit(cache=True, nogil=True, error_model="numpy")
def _n_steps(field: HeightField, lateral: float) -> int:
    # A few nodes a step: finer than any feature of the relief, coarser than the table.
    return 1 + int(lateral / max(_STEP_MM, 2.0 * field.pitch))


@njit(cache=True, nogil=True, error_model="numpy")
def _refine(
    field: HeightField,
    ox: float,
    oy: float,
    oz: float,
    dx: float,
    dy: float,
    dz: float,
    t_before: float,
    t_after: float,
    t: float,
) -> float:
    for _ in range(_NEWTON_STEPS):
        z, z_x, z_y = height_and_slope(field, ox + t * dx, oy + t * dy)
        g, g_t = oz + t * dz - z, dz - z_x * dx - z_y * dy
        # A ray that grazes has no Newton step; the bracket holds it.
        t_next = t - g / g_t if g_t < 0.0 else 0.5 * (t_before + t_after)
        t = min(max(t_next, t_before), t_after)
    return t


@njit(cache=True, nogil=True, error_model="numpy")
def first_hit(field: HeightField, ox: float, oy: float, oz: float, dx: float, dy: float, dz: float) -> float:
    """Return t of the first point o + t d on the surface; d points downwards (dz < 0)."""
    t_top, t_bottom = (field.high - oz) / dz, (field.low - oz) / dz
    outside = _misses_field(field, ox + t_top * dx, oy + t_top * dy, ox + t_bottom * dx, oy + t_bottom * dy)
    if outside:
        return -oz / dz
    n = _n_steps(field, (t_bottom - t_top) * math.hypot(dx, dy))
    dt = (t_bottom - t_top) / n
    t, g = t_top, field.high - rough_height(field, ox + t_top * dx, oy + t_top * dy)
    for k in range(1, n + 1):
        t_next = t_top + k * dt
        g_next = oz + t_next * dz - rough_height(field, ox + t_next * dx, oy + t_next * dy)
        if g_next <= 0.0:
            secant = t + dt * g / max(g - g_next, 1e-12)
            return _refine(field, ox, oy, oz, dx, dy, dz, t, t_next, secant)
        t, g = t_next, g_next
    return -oz / dz


@njit(cache=True, nogil=True, error_model="numpy")
def in_sight(field: HeightField, x: float, y: float, z: float, px: float, py: float, pz: float) -> bool:
    """Return whether nothing of the surface stands between (x, y, z) on it and the point p above it."""
    if z >= field.high or pz <= z:
        return pz > z
    share = (field.high - z) / (pz - z)
    dx, dy, dz = (px - x) * share, (py - y) * share, field.high - z
    if _misses_field(field, x, y, x + dx, y + dy):
        return True
    n = _n_steps(field, math.hypot(dx, dy))
    for k in range(1, n):
        s = k / n
        if rough_height(field, x + s * dx, y + s * dy) > z + s * dz + _BIAS_MM:
            return False
    return True
