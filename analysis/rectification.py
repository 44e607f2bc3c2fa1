"""Resample a picture onto the plane of the sample, straight from the Bayer mosaic.

Each pixel of the grid gathers the samples of each colour under a Gaussian footprint and fits a plane to
them (local linear regression), whose value at the centre is the result. So demosaicing, anti-aliasing
and resampling are one linear step; colours have the same footprint, no colour is shifted against
another, and the variance of the result follows from the weights.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

SENSOR_SIGMA_PX = 0.75
"""Least footprint: a colour that fills one pixel in four needs this much to be interpolated smoothly."""

_REACH = 2.6  # footprint's radius in sigmas; what lies beyond has 3 % of the peak weight
_CLIPPED_SHARE = 0.02


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
        """Return where `points` (..., 3) of the sample frame, mm, fall in the picture: (..., 2) pixels."""
        rotation_vector = cv2.Rodrigues(self.rotation)[0]
        flat = np.ascontiguousarray(points.reshape(-1, 1, 3))
        pixels, _ = cv2.projectPoints(flat, rotation_vector, self.translation, self.camera_matrix, self.distortion)
        return np.asarray(pixels, np.float64).reshape(*points.shape[:-1], 2)


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
) -> Rectified:
    """Resample a mosaic picture onto `points`.

    Parameters
    ----------
    mean, variance, saturated : ndarray, shape (height, width)
        The picture (`analysis.hdr.Radiance`).
    bayer_pattern : str
        E.g. ``"RGGB"``; ``""`` for monochrome.
    view : View
    points : ndarray, shape (rows, columns, 3)
        Sample frame, mm.
    pitch : float
        Size of a grid pixel, mm.
    """
    pixels = view.project(points)
    step = 0.5 * pitch
    # d(pixel) / d(grid pixel) along x and y: the footprint of a grid pixel in the picture.
    right, up = np.array([step, 0.0, 0.0]), np.array([0.0, step, 0.0])
    along_x = view.project(points + right) - view.project(points - right)
    along_y = view.project(points + up) - view.project(points - up)
    cell = channel_of_cell(bayer_pattern)
    n_channels = int(cell.max()) + 1
    radiance, noise, clipped = _gather(mean, variance, saturated, cell, n_channels, pixels, along_x, along_y)
    return Rectified(radiance, noise, clipped, pixels)


@njit(cache=True, nogil=True, parallel=True)
def _gather(
    mean: Array32,
    variance: Array32,
    saturated: NDArray[np.bool_],
    cell: NDArray[np.int64],
    n_channels: int,
    pixels: Array,
    along_x: Array,
    along_y: Array,
) -> tuple[Array32, Array32, NDArray[np.uint8]]:
    rows, columns = pixels.shape[:2]
    height, width = mean.shape
    radiance = np.full((rows, columns, n_channels), np.nan, np.float32)
    noise = np.full((rows, columns, n_channels), np.nan, np.float32)
    clipped = np.zeros((rows, columns, n_channels), np.uint8)
    for i in prange(rows):
        M = np.empty((n_channels, 6))
        solution = np.empty((n_channels, 3))
        for j in range(columns):
            x, y = pixels[i, j]
            # Covariance of the footprint: a box of one grid pixel (1/12 per axis) and the sensor's own.
            sxx = (along_x[i, j, 0] ** 2 + along_y[i, j, 0] ** 2) / 12.0 + SENSOR_SIGMA_PX**2
            syy = (along_x[i, j, 1] ** 2 + along_y[i, j, 1] ** 2) / 12.0 + SENSOR_SIGMA_PX**2
            sxy = (along_x[i, j, 0] * along_x[i, j, 1] + along_y[i, j, 0] * along_y[i, j, 1]) / 12.0
            determinant = sxx * syy - sxy * sxy
            reach_x, reach_y = _REACH * np.sqrt(sxx), _REACH * np.sqrt(syy)
            if not (x - reach_x >= 0 and x + reach_x < width and y - reach_y >= 0 and y + reach_y < height):
                continue
            first_x, last_x = int(np.ceil(x - reach_x)), int(np.floor(x + reach_x))
            first_y, last_y = int(np.ceil(y - reach_y)), int(np.floor(y + reach_y))
            M[:] = 0.0
            for r in range(first_y, last_y + 1):
                for c in range(first_x, last_x + 1):
                    dx, dy = c - x, r - y
                    w = np.exp(-0.5 * (syy * dx * dx - 2 * sxy * dx * dy + sxx * dy * dy) / determinant)
                    m = M[cell[r & 1, c & 1]]
                    m[0] += w
                    m[1] += w * dx
                    m[2] += w * dy
                    m[3] += w * dx * dx
                    m[4] += w * dx * dy
                    m[5] += w * dy * dy
            for ch in range(n_channels):
                _first_row_of_inverse(M[ch], solution[ch])
                radiance[i, j, ch] = 0.0
                noise[i, j, ch] = 0.0
            for r in range(first_y, last_y + 1):
                for c in range(first_x, last_x + 1):
                    ch = cell[r & 1, c & 1]
                    dx, dy = c - x, r - y
                    w = np.exp(-0.5 * (syy * dx * dx - 2 * sxy * dx * dy + sxx * dy * dy) / determinant)
                    weight = w * (solution[ch, 0] + solution[ch, 1] * dx + solution[ch, 2] * dy)
                    radiance[i, j, ch] += weight * mean[r, c]
                    noise[i, j, ch] += weight * weight * variance[r, c]
                    if saturated[r, c] and abs(weight) > _CLIPPED_SHARE:
                        clipped[i, j, ch] = 1
    return radiance, noise, clipped


@njit(cache=True, nogil=True)
def _first_row_of_inverse(m: Array, out: Array) -> None:
    """First row of the inverse of [[m0 m1 m2], [m1 m3 m4], [m2 m4 m5]]: the fitted plane's value at the centre."""
    c0 = m[3] * m[5] - m[4] * m[4]
    c1 = m[2] * m[4] - m[1] * m[5]
    c2 = m[1] * m[4] - m[2] * m[3]
    determinant = m[0] * c0 + m[1] * c1 + m[2] * c2
    if determinant > 1e-9 * m[0] ** 3:
        out[0], out[1], out[2] = c0 / determinant, c1 / determinant, c2 / determinant
    else:
        # Too few samples of this colour for a plane: their weighted mean.
        out[0], out[1], out[2] = 1.0 / max(m[0], 1e-300), 0.0, 0.0
