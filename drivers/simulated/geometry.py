"""Frames of the bench: sample -> stage -> lab -> camera, as 4 x 4 matrices in mm.

The lens stands at (0, 0, working distance) of the lab frame and looks down -z. The camera frame is
OpenCV's: x right, y down, z forward; so camera x is lab x and camera y is minus lab y.
"""

from __future__ import annotations

from typing import cast

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

Matrix = NDArray[np.float64]


def rotation(rotation_vector: NDArray[np.float64]) -> Matrix:
    """Return the 4 x 4 rotation about a vector whose length is the angle in radians."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(rotation_vector).as_matrix()
    return matrix


def translation(offset_mm: NDArray[np.float64]) -> Matrix:
    """Return the 4 x 4 translation by `offset_mm`, shape (3,)."""
    matrix = np.eye(4)
    matrix[:3, 3] = offset_mm
    return matrix


def stage_rotation(tilt_deg: float, turn_deg: float) -> Matrix:
    """Return R_x(tilt) R_z(turn): the turntable rides on the tilt."""
    tilt = rotation(np.radians(tilt_deg) * np.array([1.0, 0.0, 0.0]))
    turn = rotation(np.radians(turn_deg) * np.array([0.0, 0.0, 1.0]))
    return tilt @ turn


def camera_from_lab(working_distance_mm: float) -> Matrix:
    """Return the 4 x 4 matrix from lab to camera coordinates."""
    flip = np.diag([1.0, -1.0, -1.0, 1.0])
    return flip @ translation(np.array([0.0, 0.0, -working_distance_mm]))


def into(matrix: Matrix, point: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return `point`, shape (3,), as seen in the frame that `matrix` maps from."""
    inverse = np.linalg.inv(matrix)
    return cast("NDArray[np.float64]", inverse[:3, :3] @ point + inverse[:3, 3])
