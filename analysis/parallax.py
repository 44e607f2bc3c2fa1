"""Views registered to the plane z = 0, resampled so that each pixel follows its own surface point.

A point at height z above the plane is seen by the camera C where the line of sight meets the plane,

    p = C + (X - C) C_z / (C_z - z) ,

so a stack that was registered to the plane shows it shifted, by z times the tangent of the view angle.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.stack import Stack

Array = NDArray[np.float64]


def parallax_shift(stack: Stack, depth: Array) -> Array:
    """Return how far each view shows each surface point from its own pixel.

    Parameters
    ----------
    stack : Stack
    depth : ndarray, shape (H, W)
        Millimetres; NaN counts as 0.

    Returns
    -------
    ndarray, shape (N, H, W, 2)
        Columns and rows, pixels.
    """
    z = np.nan_to_num(depth)
    X = stack.grid.points()
    C = stack.camera_position[:, None, None, :]
    factor = z / (C[..., 2] - z)
    shift_x = (X[..., 0] - C[..., 0]) * factor / stack.pixel_pitch
    shift_y = (X[..., 1] - C[..., 1]) * factor / stack.pixel_pitch
    return np.stack([shift_x, -shift_y], axis=-1)


def follow_surface(stack: Stack, depth: Array) -> Stack:
    """Resample every view (bicubic) so that pixel (i, j) shows the point at height ``depth[i, j]`` above it.

    Parameters
    ----------
    stack : Stack
        Registered to the plane z = 0.
    depth : ndarray, shape (H, W)
        Millimetres; NaN counts as 0.
    """
    shift = parallax_shift(stack, depth).astype(np.float32)
    rows, columns = np.meshgrid(
        np.arange(stack.grid.height, dtype=np.float32),
        np.arange(stack.grid.width, dtype=np.float32),
        indexing="ij",
    )
    radiance = np.empty_like(stack.radiance)
    variance = None if stack.variance is None else np.empty_like(stack.variance)
    saturated = None if stack.saturated is None else np.empty_like(stack.saturated)
    for v in range(stack.n_views):
        # Contiguous 2-D maps: OpenCV 5.0 misreads strided ones without an error.
        x = np.ascontiguousarray(columns + shift[v, ..., 0])
        y = np.ascontiguousarray(rows + shift[v, ..., 1])
        radiance[v] = _remap(stack.radiance[v], x, y, cv2.INTER_CUBIC)
        if variance is not None and stack.variance is not None:
            variance[v] = _remap(stack.variance[v], x, y, cv2.INTER_LINEAR)
        if saturated is not None and stack.saturated is not None:
            # A value interpolated from any clipped sample is a bound too.
            share = _remap(stack.saturated[v].astype(np.float32), x, y, cv2.INTER_LINEAR)
            saturated[v] = np.nan_to_num(share) > 0.0
    return replace(stack, radiance=radiance, variance=variance, saturated=saturated)


def _remap(
    image: NDArray[np.float32], x: NDArray[np.float32], y: NDArray[np.float32], method: int
) -> NDArray[np.float32]:
    out = cv2.remap(image, x, y, method, borderMode=cv2.BORDER_CONSTANT, borderValue=(np.nan, np.nan, np.nan))
    return np.asarray(out, np.float32).reshape(image.shape)
