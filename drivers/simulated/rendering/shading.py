"""Light reflected by a point of the sample towards the camera."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drivers.simulated.rendering.boards import ink_at
from drivers.simulated.rendering.brdf import Rgb, brdf
from drivers.simulated.rendering.compiling import njit
from drivers.simulated.rendering.heightfield import HeightField, height_and_slope
from drivers.simulated.rendering.materials import BACKGROUND_ALBEDO, INK_ALBEDO, WHITE_PAPER
from drivers.simulated.rendering.rays import in_sight
from drivers.simulated.rendering.scene import Surface

Array = NDArray[np.float64]

_PAPER_ALBEDO = WHITE_PAPER.albedo[0]

# Below this share a material does not show, and need not be evaluated.
_LEAST_SHARE = 1e-4


@njit(cache=True, nogil=True, error_model="numpy")
def plate_albedo(surface: Surface, x: float, y: float) -> float:
    """Return the albedo of the plate, its ink or the dark table round it."""
    if abs(x) > surface.plate_half or abs(y) > surface.plate_half:
        return BACKGROUND_ALBEDO
    return _PAPER_ALBEDO + (INK_ALBEDO - _PAPER_ALBEDO) * ink_at(surface.ink, x, y)


@njit(cache=True, nogil=True, error_model="numpy")
def _cell(field: HeightField, x: float, y: float) -> tuple[int, int, float, float]:
    """Return the node below and left of a point and the way to the next ones; row -1 off the grid."""
    u, v = (x - field.x0) / field.pitch, (y - field.y0) / field.pitch
    ny, nx = field.heights.shape
    if not (u >= 0.0 and v >= 0.0 and u < nx - 1 and v < ny - 1):
        return -1, -1, 0.0, 0.0
    i, j = int(u), int(v)
    return j, i, u - i, v - j


@njit(cache=True, nogil=True, error_model="numpy")
def _share(weights: NDArray[np.float32], j: int, i: int, s: float, t: float, m: int) -> float:
    """Return the share of material `m` of the insert, bilinear in a cell."""
    below = weights[j, i, m] * (1.0 - s) + weights[j, i + 1, m] * s
    above = weights[j + 1, i, m] * (1.0 - s) + weights[j + 1, i + 1, m] * s
    return float(below * (1.0 - t) + above * t)


@njit(cache=True, nogil=True, error_model="numpy")
def _mixed_brdf(
    surface: Surface, x: float, y: float, n_l: float, n_v: float, n_h: float, v_h: float, l_v: float
) -> Rgb:
    r = g = b = 0.0
    rest = 1.0
    j, i, s, t = _cell(surface.field, x, y)
    if j >= 0:
        for m in range(surface.rows.shape[0]):
            share = _share(surface.weights, j, i, s, t, m)
            if share > _LEAST_SHARE:
                f_r, f_g, f_b = brdf(surface.rows, m, n_l, n_v, n_h, v_h, l_v)
                r, g, b, rest = r + share * f_r, g + share * f_g, b + share * f_b, rest - share
    if rest > _LEAST_SHARE:
        plate = rest * plate_albedo(surface, x, y) / math.pi
        r, g, b = r + plate, g + plate, b + plate
    return r, g, b


@njit(cache=True, nogil=True, error_model="numpy")
def reflected_by_plate(albedo: float, x: float, y: float, lx: float, ly: float, lz: float) -> float:
    """Return what a matte point of the plate (z = 0) reflects in any direction, 1/(sr mm^2)."""
    d2 = (lx - x) ** 2 + (ly - y) ** 2 + lz * lz
    return albedo / math.pi * max(0.0, lz) / math.sqrt(d2) / d2


@njit(cache=True, nogil=True, error_model="numpy")
def reflected(
    surface: Surface,
    x: float,
    y: float,
    z: float,
    z_x: float,
    z_y: float,
    cx: float,
    cy: float,
    cz: float,
    lx: float,
    ly: float,
    lz: float,
) -> Rgb:
    """Return f(omega_i, omega_o) max(0, n.omega_i) / |light - x|^2, per channel, 1/(sr mm^2).

    Parameters
    ----------
    surface : Surface
        The sample.
    x, y, z, z_x, z_y : float
        Point (mm) and slopes there.
    cx, cy, cz, lx, ly, lz : float
        Camera and light, mm.
    """
    scale = 1.0 / math.sqrt(1.0 + z_x * z_x + z_y * z_y)
    nx, ny, nz = -z_x * scale, -z_y * scale, scale
    ix, iy, iz = lx - x, ly - y, lz - z
    ox, oy, oz = cx - x, cy - y, cz - z
    d2 = ix * ix + iy * iy + iz * iz
    per_i, per_o = 1.0 / math.sqrt(d2), 1.0 / math.sqrt(ox * ox + oy * oy + oz * oz)
    ix, iy, iz, ox, oy, oz = ix * per_i, iy * per_i, iz * per_i, ox * per_o, oy * per_o, oz * per_o
    n_l, n_v = nx * ix + ny * iy + nz * iz, nx * ox + ny * oy + nz * oz
    if n_l <= 0.0 or n_v <= 0.0:
        return 0.0, 0.0, 0.0
    l_v = ix * ox + iy * oy + iz * oz
    length = math.sqrt(max(2.0 + 2.0 * l_v, 1e-30))
    f_r, f_g, f_b = _mixed_brdf(surface, x, y, n_l, n_v, (n_l + n_v) / length, (1.0 + l_v) / length, l_v)
    arriving = n_l / d2
    return f_r * arriving, f_g * arriving, f_b * arriving


@njit(cache=True, nogil=True, error_model="numpy")
def radiance_of_points(surface: Surface, x: Array, y: Array, camera: Array, light: Array) -> Array:
    """Return `reflected`, shape (n, 3), at the surface points over `x`, `y` of shape (n,)."""
    out = np.empty((x.size, 3))
    cx, cy, cz = camera
    lx, ly, lz = light
    for k in range(x.size):
        z, z_x, z_y = height_and_slope(surface.field, x[k], y[k])
        r, g, b = reflected(surface, x[k], y[k], z, z_x, z_y, cx, cy, cz, lx, ly, lz)
        out[k, 0], out[k, 1], out[k, 2] = r, g, b
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def points_in_sight(surface: Surface, x: Array, y: Array, point: Array) -> NDArray[np.bool_]:
    """Return whether the surface points over `x`, `y` of shape (n,) face `point` and see it."""
    out = np.zeros(x.size, dtype=np.bool_)
    px, py, pz = point
    for k in range(x.size):
        z, z_x, z_y = height_and_slope(surface.field, x[k], y[k])
        faces = pz - z - z_x * (px - x[k]) - z_y * (py - y[k]) > 0.0
        out[k] = faces and in_sight(surface.field, x[k], y[k], z, px, py, pz)
    return out


@njit(cache=True, nogil=True, error_model="numpy")
def shares_of_points(surface: Surface, x: Array, y: Array) -> Array:
    """Return the shares of the materials, the plate last, shape (n, n_materials + 1)."""
    n_materials = surface.rows.shape[0]
    out = np.zeros((x.size, n_materials + 1))
    for k in range(x.size):
        out[k, n_materials] = 1.0
        j, i, s, t = _cell(surface.field, x[k], y[k])
        if j < 0:
            continue
        for m in range(n_materials):
            out[k, m] = _share(surface.weights, j, i, s, t, m)
            out[k, n_materials] -= out[k, m]
    return out
