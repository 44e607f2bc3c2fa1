"""The forward renderer: what falls on the sensor, per pixel and channel, for light of unit power."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

import numpy as np
from numpy.typing import NDArray

from drivers.simulated.rendering.boards import board_at
from drivers.simulated.rendering.brdf import Rgb
from drivers.simulated.rendering.compiling import njit
from drivers.simulated.rendering.heightfield import height_and_slope
from drivers.simulated.rendering.rays import first_hit, in_sight
from drivers.simulated.rendering.scene import Surface
from drivers.simulated.rendering.shading import plate_albedo, reflected, reflected_by_plate
from drivers.simulated.rendering.view import View, lobe, ray, transmission

_ROWS_PER_TASK = 24

# Rays per side of a pixel. Edges of the print are what the analysis measures: they get the most.
_RAYS_ON_PRINT, _RAYS_ON_RELIEF, _RAYS_ON_PAPER = 4, 2, 2

# Rays that do not go down by at least this much never meet the sample.
_LEVEL = -1e-9


@njit(cache=True, nogil=True, error_model="numpy")
def _relief_along(surface: Surface, view: View, dx: float, dy: float, dz: float) -> Rgb:
    """Return the radiance of the first point of the relief on a ray."""
    ox, oy, oz = view.camera
    lx, ly, lz = view.light
    t = first_hit(surface.field, ox, oy, oz, dx, dy, dz)
    x, y = ox + t * dx, oy + t * dy
    z, z_x, z_y = height_and_slope(surface.field, x, y)
    if not in_sight(surface.field, x, y, z, lx, ly, lz):
        return 0.0, 0.0, 0.0
    share = lobe(view, x, y, z)
    r, g, b = reflected(surface, x, y, z, z_x, z_y, ox, oy, oz, lx, ly, lz)
    return share * r, share * g, share * b


@njit(cache=True, nogil=True, error_model="numpy")
def _relief_pixel(surface: Surface, view: View, u: float, v: float) -> Rgb:
    n = _RAYS_ON_RELIEF
    r = g = b = 0.0
    for k in range(n * n):
        dx, dy, dz = ray(view, u + _offset(k % n, n), v + _offset(k // n, n))
        if dz < _LEVEL:
            r_k, g_k, b_k = _relief_along(surface, view, dx, dy, dz)
            r, g, b = r + r_k, g + g_k, b + b_k
    return r / (n * n), g / (n * n), b / (n * n)


@njit(cache=True, nogil=True, error_model="numpy")
def _plate_pixel(surface: Surface, view: View, u: float, v: float, x: float, y: float) -> float:
    """Return the radiance of a pixel whose centre sees (x, y): only the print varies inside it."""
    n = _RAYS_ON_PRINT if board_at(surface.ink, x, y, 0.5) >= 0 else _RAYS_ON_PAPER
    albedo = 0.0
    for k in range(n * n):
        dx, dy, dz = ray(view, u + _offset(k % n, n), v + _offset(k // n, n))
        if dz < _LEVEL:
            t = -view.camera[2] / dz
            albedo += plate_albedo(surface, view.camera[0] + t * dx, view.camera[1] + t * dy)
    lx, ly, lz = view.light
    return reflected_by_plate(albedo / (n * n), x, y, lx, ly, lz) * lobe(view, x, y, 0.0)


@njit(cache=True, nogil=True, error_model="numpy")
def _offset(k: int, n: int) -> float:
    """Return the centre of the k-th of n cells across a pixel, whose own centre is 0."""
    return (k + 0.5) / n - 0.5


@njit(cache=True, nogil=True, error_model="numpy")
def _pixel(surface: Surface, view: View, u: float, v: float) -> Rgb:
    dx, dy, dz = ray(view, u, v)
    if dz >= _LEVEL:
        return 0.0, 0.0, 0.0
    t = -view.camera[2] / dz
    x, y = view.camera[0] + t * dx, view.camera[1] + t * dy
    # The table of heights ends well outside the relief: beyond it all is flat, and stays unshadowed.
    if abs(x) < -surface.field.x0 and abs(y) < -surface.field.y0:
        return _relief_pixel(surface, view, u, v)
    grey = _plate_pixel(surface, view, u, v, x, y)
    return grey, grey, grey


@njit(cache=True, nogil=True, error_model="numpy")
def _render_rows(surface: Surface, view: View, first: int, last: int, picture: NDArray[np.float32]) -> None:
    for i in range(first, last):
        for j in range(picture.shape[1]):
            r, g, b = _pixel(surface, view, float(j), float(i))
            through = transmission(view, float(j), float(i))
            picture[i, j, 0] = through * r
            picture[i, j, 1] = through * g
            picture[i, j, 2] = through * b


def _in_bands(n_rows: int, work: Callable[[int, int], None], n_threads: int | None) -> None:
    starts = range(0, n_rows, _ROWS_PER_TASK)
    with ThreadPoolExecutor(n_threads or os.cpu_count()) as pool:
        list(pool.map(lambda first: work(first, min(first + _ROWS_PER_TASK, n_rows)), starts))


def render(surface: Surface, view: View, height: int, width: int, n_threads: int | None = None) -> NDArray[np.float32]:
    """Return the picture, shape (height, width, 3): radiance times lobe and vignetting, 1/(sr mm^2).

    Pixels do not depend on each other, so neither does the picture on the number of threads.
    """
    picture = np.empty((height, width, 3), dtype=np.float32)
    _in_bands(height, lambda first, last: _render_rows(surface, view, first, last, picture), n_threads)
    return picture
