"""The lens: a pinhole with the distortion of Brown and Conrady."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LENS_NAMES = ("f", "aspect", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
"""Unknowns of the lens: fy is f, fx is aspect times f; the distortion is Brown and Conrady's, as OpenCV has it."""


@dataclass(frozen=True, slots=True)
class Lens:
    """Intrinsics.

    Attributes
    ----------
    values : ndarray, shape (9,)
        In the order of `LENS_NAMES`; pixels for f, cx, cy.
    """

    values: Array

    @classmethod
    def of(cls, camera_matrix: Array, distortion: Array) -> Lens:
        """Build from OpenCV's matrix and k1, k2, p1, p2, k3."""
        K = camera_matrix
        return cls(np.array([K[1, 1], K[0, 0] / K[1, 1], K[0, 2], K[1, 2], *distortion], np.float64))

    @property
    def camera_matrix(self) -> Array:
        """OpenCV's matrix, shape (3, 3), pixels."""
        f, aspect, cx, cy = self.values[:4]
        return np.array([[aspect * f, 0.0, cx], [0.0, f, cy], [0.0, 0.0, 1.0]])

    @property
    def distortion(self) -> Array:
        """k1, k2, p1, p2, k3."""
        return self.values[4:]

    def undistort(self, pixels: Array) -> Array:
        """Return where points seen at `pixels` (n, 2) would be without distortion, pixels."""
        K = self.camera_matrix
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-10)
        ideal = cv2.undistortPoints(
            np.ascontiguousarray(pixels).reshape(-1, 1, 2), K, self.distortion, R=np.eye(3), P=K, criteria=criteria
        )
        return np.asarray(ideal, np.float64).reshape(-1, 2)

    def distort(self, pixels: Array) -> Array:
        """Return where points that would be at `pixels` (n, 2) without distortion are seen, pixels."""
        rays = np.concatenate([pixels, np.ones((len(pixels), 1))], axis=1) @ np.linalg.inv(self.camera_matrix).T
        return self.project(rays)[0]

    def project(self, in_camera: Array) -> tuple[Array, Array, Array]:
        """Return pixels (n, 2), their derivatives by the points (n, 2, 3) and by `values` (n, 2, 9)."""
        zero = np.zeros(3)
        pixels, J = cv2.projectPoints(
            np.ascontiguousarray(in_camera).reshape(-1, 1, 3), zero, zero, self.camera_matrix, self.distortion
        )
        J = J.reshape(-1, 2, J.shape[1])
        by_lens = np.empty((len(J), 2, 9))
        f, aspect = self.values[:2]
        by_lens[..., 0] = aspect * J[..., 6] + J[..., 7]
        by_lens[..., 1] = f * J[..., 6]
        by_lens[..., 2:4] = J[..., 8:10]
        by_lens[..., 4:] = J[..., 10:15]
        return np.asarray(pixels, np.float64).reshape(-1, 2), np.asarray(J[..., 3:6], np.float64), by_lens
