"""Views registered to the plane z = 0, resampled so that each pixel follows its own surface point.

A point at height z above the plane is seen by the camera C where the line of sight meets the plane,

    p = C + (X - C) C_z / (C_z - z) ,

so a stack that was registered to the plane shows it shifted, by z times the tangent of the view angle.
"""

from __future__ import annotations

import numpy as np
from numba import prange
from numpy.typing import NDArray

from analysis.compiling import njit
from analysis.pixels.samples import Samples
from analysis.registration.stack import Stack

Array = NDArray[np.float64]

Array32 = NDArray[np.float32]

Mask = NDArray[np.uint8]

_CLIPPED_SHARE = 0.02  # of a value, from clipped samples, that leaves it a value


def parallax_shift(stack: Stack, depth: Array, pixels: NDArray[np.int64] | None = None) -> Array:
    """Return how far each view shows each surface point from its own pixel.

    Parameters
    ----------
    stack : Stack
    depth : ndarray, shape (H, W)
        Millimetres; NaN counts as 0.
    pixels : ndarray of int, shape (P,), or None
        Flat indices of the pixels asked about; None = all, H * W of them.

    Returns
    -------
    ndarray, shape (N, P, 2)
        Columns and rows, pixels.
    """
    z = np.nan_to_num(depth).ravel()
    X = stack.grid.points().reshape(-1, 3)
    if pixels is not None:
        z, X = z[pixels], X[pixels]
    C = stack.camera_position[:, None, :]
    factor = z / (C[..., 2] - z)
    shift_x = (X[:, 0] - C[..., 0]) * factor / stack.pixel_pitch
    shift_y = (X[:, 1] - C[..., 1]) * factor / stack.pixel_pitch
    return np.stack([shift_x, -shift_y], axis=-1)


def follow_pixels(stack: Stack, depth: Array, pixels: NDArray[np.int64]) -> Samples:
    """Resample every view (bicubic) where it shows the surface points of some pixels.

    Variance is propagated through the weights; a value interpolated from any clipped sample is a bound too.

    Parameters
    ----------
    stack : Stack
        Registered to the plane z = 0.
    depth : ndarray, shape (H, W)
        Millimetres; NaN counts as 0.
    pixels : ndarray of int, shape (P,)
        Flat indices.
    """
    n_views, height, width, n_channels = stack.radiance.shape
    shape = (n_views, len(pixels), n_channels)
    z = np.nan_to_num(depth).ravel()[pixels]
    i, j = np.divmod(pixels, width)
    out = Samples(np.empty(shape, np.float32), np.zeros(shape, np.float32), np.zeros(shape, np.uint8))
    # Without a variance or a mask there is nothing to resample; an empty picture stands in for the kernel.
    nothing = np.zeros((0, 0, 0), np.float32)
    for v, camera in enumerate(stack.camera_position):
        # The line of sight from the camera through the surface point meets the plane so far from it.
        factor = z / (camera[2] - z) / stack.pixel_pitch
        x = j + ((j - 0.5 * (width - 1)) * stack.pixel_pitch - camera[0]) * factor
        y = i - ((0.5 * (height - 1) - i) * stack.pixel_pitch - camera[1]) * factor
        rows = slice(max(int(y.min()) - 3, 0), max(min(int(y.max()) + 4, height), 0)) if len(y) else slice(0)
        _resample(
            np.asarray(stack.radiance[v, rows], np.float32),
            nothing if stack.variance is None else np.asarray(stack.variance[v, rows], np.float32),
            nothing.astype(np.uint8) if stack.saturated is None else np.asarray(stack.saturated[v, rows], np.uint8),
            rows.start or 0,
            height,
            x,
            y,
            out.radiance[v],
            out.variance[v],
            out.saturated[v],
        )
    return out


@njit(cache=True, nogil=True)
def _catmull_rom(f: float) -> tuple[float, float, float, float]:
    """Weights of the samples at -1, 0, 1, 2 for a point at 0 <= f < 1 [keys1981, a = -1/2]."""
    return (
        f * (-0.5 + f * (1.0 - 0.5 * f)),
        1.0 + f * f * (-2.5 + 1.5 * f),
        f * (0.5 + f * (2.0 - 1.5 * f)),
        f * f * (-0.5 + 0.5 * f),
    )


@njit(cache=True, nogil=True, parallel=True)
def _resample(
    radiance: Array32,
    variance: Array32,
    saturated: Mask,
    first_row: int,
    height: int,
    x: Array,
    y: Array,
    out_radiance: Array32,
    out_variance: Array32,
    out_saturated: Mask,
) -> None:
    """Interpolate one view's rows from `first_row` on at (x, y), in pixels of the whole picture of `height` rows."""
    n_rows, width, n_channels = radiance.shape
    for p in prange(x.shape[0]):
        # Within half a pixel of the border the outermost samples are repeated; beyond, nothing is known.
        inside = n_rows > 0 and -0.5 <= x[p] <= width - 0.5 and -0.5 <= y[p] <= height - 0.5
        x0, y0 = int(np.floor(x[p])), int(np.floor(y[p]))
        w_x, w_y = _catmull_rom(x[p] - x0), _catmull_rom(y[p] - y0)
        for ch in range(n_channels):
            value, noise, clipped = 0.0, 0.0, 0.0
            for a in range(4 if inside else 0):
                r = min(max(y0 - 1 + a, 0), height - 1) - first_row
                for b in range(4):
                    c = min(max(x0 - 1 + b, 0), width - 1)
                    w = w_x[b] * w_y[a]
                    # A missing sample of no weight must not make its neighbour missing.
                    if w != 0.0:
                        value += w * radiance[r, c, ch]
                        if variance.size > 0:
                            noise += w * w * variance[r, c, ch]
                        if saturated.size > 0:
                            clipped += abs(w * radiance[r, c, ch]) if saturated[r, c, ch] > 0 else 0.0
            out_radiance[p, ch] = value if inside else np.nan
            if variance.size > 0:
                out_variance[p, ch] = noise if inside else np.nan
            if saturated.size > 0:
                out_saturated[p, ch] = clipped > _CLIPPED_SHARE * abs(value)
