"""Where the light stands, from the plane that pictures are registered to.

A light that is s beside the lens turns every half vector by about s / 2d, in the camera's frame and so, for a camera
that is held the same way up, in the sample's: normals found with the light in the lens then lean by as much. No
residual shows it, since another tilt of the whole sample would look the same. But pictures registered to the sample's
plane say what its mean normal is: that of the plane.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.registration.lighting import LightOffset
from analysis.registration.stack import Stack

Array = NDArray[np.float64]

PLANE_SIGMA_DEG = 0.5
"""How far the mean normal of a sample may lean from the plane that somebody clicked or fitted, one sigma."""

MODEL_ERROR = 0.3
"""Share of the offset that its sigma has at least: the turn of the half vectors is as far as the curves are right."""

TORCH_MM = (5.0, 40.0)
"""How far the torch of a telephone stands from its lens."""

_BLOCKS = 6


def offset_by_plane(stack: Stack, normals: Array) -> LightOffset:
    """Return the offset with which the mean normal is z.

    With n the mean normal found with the light where the stack has it and R the mean rotation into the camera, the
    light has to move by -2 d R (n - z) in the camera's frame.

    Parameters
    ----------
    stack : Stack
        With `camera_rotation`.
    normals : ndarray, shape (H, W, 3)
        Unit vectors; NaN = not solved.

    Raises
    ------
    ValueError
        If the stack has no rotations, or no pixel is solved.
    """
    if stack.camera_rotation is None:
        raise ValueError("the stack has no camera_rotation, so an offset in the camera frame means nothing.")
    solved = np.isfinite(normals[..., 0])
    if not solved.any():
        raise ValueError("no pixel is solved, so that the plane says nothing of the light.")
    distance = float(np.median(np.linalg.norm(stack.camera_position, axis=1)))
    rotation = stack.camera_rotation.mean(axis=0)
    now = np.einsum("nij,nj->ni", stack.camera_rotation, stack.light_position - stack.camera_position).mean(axis=0)
    mean = normals[solved].mean(axis=0)
    move = -2.0 * distance * rotation @ (mean / np.linalg.norm(mean) - [0.0, 0.0, 1.0])
    value = np.array([now[0] + move[0], now[1] + move[1], now[2]])
    plane = 2.0 * distance * np.deg2rad(PLANE_SIGMA_DEG)
    lateral = np.hypot(np.hypot(plane, MODEL_ERROR * 0.5 * np.abs(value[:2])), _scatter_mm(stack, normals, distance))
    return LightOffset(value, np.array([*lateral, np.inf]))


def _scatter_mm(stack: Stack, normals: Array, distance: float) -> Array:
    """Return the standard error of the mean of whole blocks' normals, as millimetres of the light."""
    block = stack.grid.blocks(np.arange(normals[..., 0].size), _BLOCKS)
    slope = normals.reshape(-1, 3)[:, :2]
    known = np.isfinite(slope[:, 0])
    count = np.bincount(block[known], minlength=_BLOCKS**2)
    sums = np.stack([np.bincount(block[known], slope[known, i], _BLOCKS**2) for i in range(2)], axis=1)
    means = sums[count > 0] / count[count > 0, None]
    if len(means) < 2:
        return np.full(2, np.inf)
    return np.asarray(2.0 * distance * means.std(axis=0, ddof=1) / np.sqrt(len(means)))
