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

from analysis.resampling import gather, project_all

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Grid:
    """Pixels on the sample: row i, column j is centred on x = (j - (W-1)/2) pitch, y = ((H-1)/2 - i) pitch.

    Attributes
    ----------
    height, width : int
    pitch : float
        Millimetres.
    """

    height: int
    width: int
    pitch: float

    @classmethod
    def covering(cls, area_mm: tuple[float, float], pitch: float) -> Grid:
        """Build the grid of square pixels whose outer edges cover `area_mm` (width, height)."""
        return cls(max(int(round(area_mm[1] / pitch)), 1), max(int(round(area_mm[0] / pitch)), 1), pitch)

    def points(self, depth: Array | None = None) -> Array:
        """Return the centres in the sample frame, mm, shape (height, width, 3); z = `depth`, or 0."""
        x = (np.arange(self.width) - (self.width - 1) / 2) * self.pitch
        y = ((self.height - 1) / 2 - np.arange(self.height)) * self.pitch
        xx, yy = np.meshgrid(x, y)
        return np.stack([xx, yy, np.zeros_like(xx) if depth is None else depth], axis=-1)

    def blocks(self, pixels: NDArray[np.int64], n: int) -> NDArray[np.int64]:
        """Return the number of the part of the area, `n` parts a side, that each pixel (flat index) lies in."""
        rows, columns = np.divmod(pixels, self.width)
        return np.asarray(rows * n // self.height * n + columns * n // self.width)

    def points_of(self, pixels: NDArray[np.int64], depth: Array | None = None) -> Array:
        """Return the centres of some pixels (flat indices) as `points` does, shape (P, 3)."""
        i, j = np.divmod(pixels, self.width)
        x = (j - (self.width - 1) / 2) * self.pitch
        y = ((self.height - 1) / 2 - i) * self.pitch
        return np.stack([x, y, np.zeros(len(pixels)) if depth is None else depth.ravel()[pixels]], axis=-1)


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


def channel_of_cell(bayer_pattern: str) -> NDArray[np.int64]:
    """Return the channel (R 0, G 1, B 2) of each place of the 2 x 2 cell; all 0 for a monochrome sensor."""
    if not bayer_pattern:
        return np.zeros((2, 2), np.int64)
    return np.array(["RGB".index(letter) for letter in bayer_pattern.upper()]).reshape(2, 2)


def rectify(
    mean: NDArray[np.float32],
    variance: NDArray[np.float32],
    saturated: NDArray[np.bool_],
    bayer_pattern: str,
    view: View,
    points: Array,
    pitch: float,
    hidden: NDArray[np.bool_] | None = None,
) -> Rectified:
    """Resample a picture onto `points`, which may be any rows of a grid: blocks give the same bits as the whole.

    Parameters
    ----------
    mean, variance, saturated : ndarray, shape (height, width) or (height, width, 3)
        The picture (`analysis.hdr.Radiance`): a mosaic, or with all channels at every pixel.
    bayer_pattern : str
        E.g. ``"RGGB"``; ``""`` for monochrome and for pictures with channels.
    view : View
    points : ndarray, shape (rows, columns, 3)
        Sample frame, mm.
    pitch : float
        Size of a grid pixel, mm.
    hidden : ndarray of bool, shape (rows, columns), or None
        Points that the surface itself hides from the camera or the light (`analysis.occlusion`); they come out NaN.

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
    out = Rectified(
        radiance.reshape(on_grid), noise.reshape(on_grid), clipped.reshape(on_grid), pixels.reshape(on_grid)
    )
    if hidden is not None:
        out.radiance[hidden], out.variance[hidden], out.saturated[hidden] = np.nan, np.nan, 0
    return out


def _planes(picture: NDArray[np.float32]) -> NDArray[np.float32]:
    """Return a picture as planes, shape (n_planes, height, width)."""
    planes = picture[None] if picture.ndim == 2 else np.moveaxis(picture, -1, 0)
    return np.ascontiguousarray(planes, np.float32)
