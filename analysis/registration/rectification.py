"""Resample a picture onto the plane of the sample, straight from the Bayer mosaic.

Each pixel of the grid gathers the samples of each colour under a Gaussian footprint and fits a quadratic
to them (local polynomial regression [cleveland1979]), whose value at the centre is the result. So
demosaicing, anti-aliasing and resampling are one linear step; no colour is shifted against another, and
the variance of the result follows from the weights. A plane instead of the quadratic would be the
Gaussian's plain blur, which flattens relief: slopes of 4 to 8 mm waves came out 2 to 4 % too small.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.camera.view import View
from analysis.radiometry.mosaic import channel_of_cell
from analysis.registration.resampling import gather

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Rectified:
    """One view on the grid; NaN where the picture does not show the sample.

    Attributes
    ----------
    radiance, variance : ndarray of float32, shape (height, width, n_channels)
    saturated : ndarray of uint8, shape (height, width, n_channels)
    pixels : ndarray, shape (height, width, 2)
        Where each grid pixel lies in the picture.
    """

    radiance: NDArray[np.float32]
    variance: NDArray[np.float32]
    saturated: NDArray[np.uint8]
    pixels: Array

    def scaled(self, gain: Array | NDArray[np.float32]) -> Rectified:
        """Return the view with its radiances multiplied by `gain`, which broadcasts."""
        radiance = (self.radiance * gain).astype(np.float32)
        return replace(self, radiance=radiance, variance=(self.variance * gain**2).astype(np.float32))


def rectify(
    mean: NDArray[np.float32],
    variance: NDArray[np.float32],
    saturated: NDArray[np.bool_],
    bayer_pattern: str,
    view: View,
    points: Array,
    pitch: float,
) -> Rectified:
    """Resample a picture onto `points`, which may be any rows of a grid: blocks give the same bits as the whole.

    Parameters
    ----------
    mean, variance, saturated : ndarray, shape (height, width) or (height, width, 3)
        The picture (`analysis.radiometry.hdr.Radiance`): a mosaic, or with all channels at every pixel.
    bayer_pattern : str
        E.g. ``"RGGB"``; ``""`` for monochrome and for pictures with channels.
    view : View
    points : ndarray, shape (rows, columns, 3)
        Sample frame, mm.
    pitch : float
        Size of a grid pixel, mm.

    Raises
    ------
    ValueError
        If a picture with channels comes with a pattern.
    """
    if mean.ndim == 3 and bayer_pattern:
        raise ValueError(
            f"a picture of shape {mean.shape} has all channels at every pixel; its pattern is '', not "
            f"{bayer_pattern!r}."
        )
    flat = np.ascontiguousarray(points, np.float64).reshape(-1, 3)
    signed = np.where(saturated, -variance, variance)
    cell = channel_of_cell(bayer_pattern)
    radiance, noise, clipped, pixels = gather(
        _planes(mean), _planes(signed), cell, flat, float(pitch), *view.parameters
    )
    on_grid = (*points.shape[:2], -1)
    return Rectified(
        radiance.reshape(on_grid), noise.reshape(on_grid), clipped.reshape(on_grid), pixels.reshape(on_grid)
    )


def _planes(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a picture as planes, shape (n_planes, height, width)."""
    planes = picture[None] if picture.ndim == 2 else np.moveaxis(picture, -1, 0)
    return np.ascontiguousarray(planes, np.float32)
