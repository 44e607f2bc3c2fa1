"""The camera model: a pinhole with the lens distortion k1, k2, p1, p2, k3 [brown1966], both ways."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.compiling import njit

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class View:
    """A camera that looks at the sample.

    Attributes
    ----------
    camera_matrix : ndarray, shape (3, 3)
    distortion : ndarray, shape (5,)
        OpenCV's k1, k2, p1, p2, k3.
    rotation : ndarray, shape (3, 3)
        Sample to camera.
    translation : ndarray, shape (3,)
        Sample to camera, mm.
    """

    camera_matrix: Array
    distortion: Array
    rotation: Array
    translation: Array

    def project(self, points: Array) -> Array:
        """Return where `points` (..., 3) of the sample frame, mm, fall in the picture: (..., 2) pixels.

        NaN where a point lies behind the lens.
        """
        flat = np.ascontiguousarray(points, np.float64).reshape(-1, 3)
        return project_all(flat, *self.parameters).reshape(*points.shape[:-1], 2)

    @property
    def parameters(self) -> tuple[Array, Array, Array, Array]:
        """Rotation, translation, camera matrix and distortion, as kernels take them."""
        rotation, translation, matrix, distortion = (
            np.ascontiguousarray(a, np.float64)
            for a in (self.rotation, np.ravel(self.translation), self.camera_matrix, np.ravel(self.distortion))
        )
        return rotation, translation, matrix, distortion


@njit(cache=True, nogil=True)
def project(point: Array, rotation: Array, translation: Array, matrix: Array, distortion: Array) -> tuple[float, float]:
    """Return where a point falls in the picture: a pinhole with the lens distortion k1, k2, p1, p2, k3 [brown1966]."""
    x, y, z = in_camera(point, rotation, translation)
    if not z > 0.0:
        return np.nan, np.nan
    u, v = x / z, y / z
    k1, k2, p1, p2, k3 = distortion
    r2 = u * u + v * v
    radial = 1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))
    u_d = u * radial + 2.0 * p1 * u * v + p2 * (r2 + 2.0 * u * u)
    v_d = v * radial + p1 * (r2 + 2.0 * v * v) + 2.0 * p2 * u * v
    return matrix[0, 0] * u_d + matrix[0, 1] * v_d + matrix[0, 2], matrix[1, 1] * v_d + matrix[1, 2]


@njit(cache=True, nogil=True)
def in_camera(point: Array, rotation: Array, translation: Array) -> tuple[float, float, float]:
    """Return a point of the sample frame in the camera frame, mm."""
    x = rotation[0, 0] * point[0] + rotation[0, 1] * point[1] + rotation[0, 2] * point[2] + translation[0]
    y = rotation[1, 0] * point[0] + rotation[1, 1] * point[1] + rotation[1, 2] * point[2] + translation[1]
    z = rotation[2, 0] * point[0] + rotation[2, 1] * point[1] + rotation[2, 2] * point[2] + translation[2]
    return x, y, z


@njit(cache=True, nogil=True)
def project_all(points: Array, rotation: Array, translation: Array, matrix: Array, distortion: Array) -> Array:
    """Return where points (P, 3) fall in the picture, shape (P, 2)."""
    out = np.empty((points.shape[0], 2))
    for p in range(points.shape[0]):
        out[p, 0], out[p, 1] = project(points[p], rotation, translation, matrix, distortion)
    return out


def rays(camera_matrix: Array, distortion: Array, pixel: Array) -> Array:
    """Return the directions of pixels (..., 2) in the camera frame, shape (..., 3), z = 1."""
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-10)
    flat = np.ascontiguousarray(pixel, np.float64).reshape(-1, 1, 2)
    ideal = cv2.undistortPoints(flat, camera_matrix, distortion, criteria=criteria)
    ideal = np.asarray(ideal, np.float64).reshape(*pixel.shape[:-1], 2)
    return np.concatenate([ideal, np.ones((*ideal.shape[:-1], 1))], axis=-1)
