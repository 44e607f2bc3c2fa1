"""The area as a plane or as a displaced mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from analysis.export.maps import SurfaceMaps

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Mesh:
    """Triangles over the area, seen from above counter-clockwise.

    Attributes
    ----------
    points : ndarray, shape (V, 3)
        mm; x right, y up, z out of the sample, origin in the middle of the mean plane.
    uv : ndarray, shape (V, 2)
        u right, v down, 0 to 1 over the area.
    triangles : ndarray of uint32, shape (T, 3)
    """

    points: Array
    uv: Array
    triangles: NDArray[np.uint32]


def mesh_of(maps: SurfaceMaps, n_cells: int | None) -> Mesh:
    """Return the area as a plane, or as a mesh of `n_cells` along its longer side that follows the displacement."""
    width, height = maps.size_mm
    if n_cells is None:
        columns = rows = 1
    else:
        columns, rows = (max(round(n_cells * side / max(width, height)), 1) for side in (width, height))
    u, v = np.meshgrid(np.linspace(0.0, 1.0, columns + 1), np.linspace(0.0, 1.0, rows + 1))
    z = np.zeros_like(u) if n_cells is None else _at(maps.displacement, u, v)
    points = np.stack([(u - 0.5) * width, (0.5 - v) * height, z], axis=-1)
    corner = np.arange(u.size).reshape(u.shape)
    a, b, c, d = (part.ravel() for part in (corner[:-1, :-1], corner[1:, :-1], corner[1:, 1:], corner[:-1, 1:]))
    triangles = np.stack([a, b, c, a, c, d], axis=-1).reshape(-1, 3).astype(np.uint32)
    return Mesh(points.reshape(-1, 3), np.stack([u, v], axis=-1).reshape(-1, 2), triangles)


def _at(values: Array, u: Array, v: Array) -> Array:
    """Return a map between its pixels' centres, and beyond the outermost of them their value."""
    height, width = values.shape
    return np.asarray(map_coordinates(values, [v * height - 0.5, u * width - 0.5], order=1, mode="nearest"))
