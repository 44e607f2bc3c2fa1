"""Where the light of each view stands, from its offset to the lens."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.registration.stack import Stack

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LightOffset:
    """Offset of the light from the lens.

    Attributes
    ----------
    value, sigma : ndarray, shape (3,)
        Camera frame (x right, y down, z forward), mm; sigma is one standard deviation.
    """

    value: Array
    sigma: Array


def light_position(stack: Stack, offset: Array) -> Array:
    """Return the light of every view in the sample frame, mm, shape (N, 3), for `offset` in the camera frame."""
    if stack.camera_rotation is None:
        raise ValueError("the stack has no camera_rotation, so an offset in the camera frame means nothing.")
    return np.asarray(stack.camera_position + np.einsum("nij,i->nj", stack.camera_rotation, offset))


def theta_d_deg(stack: Stack) -> Array:
    """Return half the angle between the directions to camera and light, seen from the centre, degrees, shape (N,)."""
    camera, light = (
        p / np.linalg.norm(p, axis=1, keepdims=True) for p in (stack.camera_position, stack.light_position)
    )
    chord = np.linalg.norm(camera - light, axis=1)
    return np.asarray(np.rad2deg(np.arcsin(np.clip(0.5 * chord, 0.0, 1.0))))


def camera_moves(stack: Stack) -> bool:
    """Tell whether the directions to the camera differ by more than a degree."""
    d = stack.camera_position / np.linalg.norm(stack.camera_position, axis=1, keepdims=True)
    return bool(np.linalg.norm(d - d.mean(axis=0), axis=1).max() > np.deg2rad(1.0))


def lit_from(stack: Stack, offset: LightOffset) -> Stack:
    """Return the stack with its light elsewhere.

    Powers that were found from white paper in the plane (then they have a sigma) follow the light, so that the
    white stays as bright as it was seen.
    """
    light = light_position(stack, offset.value)
    before, after = (p[:, 2] / np.linalg.norm(p, axis=1) ** 3 for p in (stack.light_position, light))
    return replace(
        stack,
        light_position=light,
        light_power=stack.light_power if stack.light_power_sigma is None else stack.light_power * before / after,
        light_offset=offset.value,
        light_offset_sigma=offset.sigma,
    )


def looking_at_centre(camera_position: Array) -> Array:
    """Return rotations sample to camera of cameras that look at the origin, held level (x of the camera along x).

    Parameters
    ----------
    camera_position : ndarray, shape (N, 3)

    Returns
    -------
    ndarray, shape (N, 3, 3)
    """
    forward = -camera_position / np.linalg.norm(camera_position, axis=1, keepdims=True)
    down = np.cross(forward, [1.0, 0.0, 0.0])
    down /= np.linalg.norm(down, axis=1, keepdims=True)
    return np.stack([np.cross(down, forward), down, forward], axis=1)
