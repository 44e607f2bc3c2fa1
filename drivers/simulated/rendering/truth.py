"""What only a simulation knows, to score results with; every length in mm, every frame the sample's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from drivers.simulated.rendering.heightfield import heights_and_slopes
from drivers.simulated.rendering.scene import Scene
from drivers.simulated.rendering.shading import points_in_sight, radiance_of_points, shares_of_points

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Truth:
    """The sample at some points.

    Attributes
    ----------
    normals : ndarray, shape (..., 3)
        Unit normals.
    depth : ndarray, shape (...)
        Height over the plate, mm.
    material : ndarray of int, shape (...)
        The material with the largest share, as an index of `material_names`.
    material_shares : ndarray, shape (..., n_materials)
        Shares; they add up to 1.
    material_names : tuple of str
        Length n_materials; the white plate is the last.
    """

    normals: Array
    depth: Array
    material: NDArray[np.int64]
    material_shares: Array
    material_names: tuple[str, ...]


def _points(x_mm: ArrayLike, y_mm: ArrayLike) -> tuple[Array, Array, tuple[int, ...]]:
    x, y = np.broadcast_arrays(np.asarray(x_mm, dtype=np.float64), np.asarray(y_mm, dtype=np.float64))
    return np.ascontiguousarray(x).ravel(), np.ascontiguousarray(y).ravel(), x.shape


def truth_at(scene: Scene, x_mm: ArrayLike, y_mm: ArrayLike) -> Truth:
    """Return the truth at points (mm) of any shape; `x_mm` and `y_mm` broadcast."""
    x, y, shape = _points(x_mm, y_mm)
    z, z_x, z_y = heights_and_slopes(scene.surface.field, x, y).T
    normals = np.stack([-z_x, -z_y, np.ones_like(z)], axis=-1)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    shares = shares_of_points(scene.surface, x, y)
    return Truth(
        normals=normals.reshape(*shape, 3),
        depth=z.reshape(shape),
        material=np.argmax(shares, axis=-1).reshape(shape),
        material_shares=shares.reshape(*shape, -1),
        material_names=scene.material_names,
    )


def radiance_at(scene: Scene, x_mm: ArrayLike, y_mm: ArrayLike, camera: ArrayLike, light: ArrayLike) -> Array:
    """Return f max(0, n.omega_i) / |light - x|^2, shape (..., 3), without cast shadows."""
    x, y, shape = _points(x_mm, y_mm)
    places = (np.asarray(place, dtype=np.float64) for place in (camera, light))
    values: Array = radiance_of_points(scene.surface, x, y, *places)
    return values.reshape(*shape, 3)


def sight_at(scene: Scene, x_mm: ArrayLike, y_mm: ArrayLike, point: ArrayLike) -> NDArray[np.bool_]:
    """Return whether each surface point faces `point`, shape (3,), with nothing in between."""
    x, y, shape = _points(x_mm, y_mm)
    seen: NDArray[np.bool_] = points_in_sight(scene.surface, x, y, np.asarray(point, dtype=np.float64))
    return seen.reshape(shape)
