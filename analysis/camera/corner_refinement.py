"""Corners of a printed board to a few hundredths of a pixel, by fitting the print to the picture.

Round each corner, the picture is modelled in every colour c as

    I(u) = a_c + b_c T(u - d) + (g . (u - u_0)) T(u - d) + b_c s Laplace T / 2 ,

with T the printed pattern as the camera would show it (through the board's homography and, once it is
known, the lens, averaged over a pixel and blurred), the shift d that is wanted, black a_c, contrast b_c,
a gradient g of the light and an excess s of the blur's variance (a Gaussian's blur solves the heat
equation). All edges within half a square take part, those of markers too. The noise of the fit gives
the covariance of d. A pixel that clips is a bound: it takes part where the model is below it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import prange
from numpy.typing import NDArray

from analysis.camera.lens import Lens
from analysis.compiling import njit

Array = NDArray[np.float64]

SUBSAMPLES = 4
"""Samples of the pattern per pixel and axis."""

_MARGIN = 3  # pixels beyond the patch that the blur reaches

_SMALLEST, _LARGEST = 4, 14  # pixels from the corner to the edge of its patch

_ROUNDS = 6

_START_BLUR, _MIN_BLUR, _MAX_BLUR = 0.12, 0.02, 2.0  # variance of the blur, pixels squared

_N_FOUND = 8

_MAX_SHIFT = 2.5  # pixels: beyond, the fit may have caught a neighbour's edge


@dataclass(frozen=True, slots=True)
class Shown:
    """A picture to measure corners in.

    Attributes
    ----------
    picture : ndarray of float32, shape (height, width)
        Linear, in the sensor's mosaic; NaN where nothing is known.
    clipped : ndarray of bool, shape (height, width)
        Where it holds no more than a lower bound.
    cell : ndarray of int, shape (2, 2)
        Channel of each place of the mosaic's cell, from 0.
    """

    picture: NDArray[np.float32]
    clipped: NDArray[np.bool_]
    cell: NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Aligned:
    """Corners of one board in one picture.

    Attributes
    ----------
    points : ndarray, shape (n, 2)
        Pixels, integer = centre of a pixel; NaN where the print does not fit the picture.
    covariance : ndarray, shape (n, 2, 2)
        Of the points, from the noise of the fit, pixels squared.
    misfit : ndarray, shape (n,)
        RMS of the fit's residual over the contrast of the print.
    contrast : ndarray, shape (n,)
        Paper minus ink; negative where the picture shows the pattern with black and white exchanged.
    blur : ndarray, shape (n,)
        Variance of the blur, pixels squared.
    """

    points: Array
    covariance: Array
    misfit: Array
    contrast: Array
    blur: Array


def align_corners(
    shown: Shown,
    pattern: NDArray[np.float32],
    texels_per_mm: float,
    homographies: Array,
    corners: Array,
    square_mm: float,
    lens: Lens | None = None,
) -> Aligned:
    """Fit the pattern round each corner.

    Parameters
    ----------
    shown : Shown
    pattern : ndarray of float32, shape (rows, columns)
        0 = ink, 1 = paper.
    texels_per_mm : float
        Of the pattern.
    homographies : ndarray, shape (n, 3, 3)
        From the board (mm) to the picture that `lens` would show without distortion (pixels), near each corner
        and good to about two pixels.
    corners : ndarray, shape (n, 2)
        The corners wanted, on the board, mm.
    square_mm : float
        Side of a square.
    lens : Lens or None
        None = taken as free of distortion. The bend of a lens within a patch, left out, shifts corners by some
        thousandths of a pixel, outwards all over the picture: enough to show in k1.
    """
    ideal = project(homographies, corners)
    predicted = ideal if lens is None else lens.distort(ideal)
    reach = _reach(homographies, corners, ideal, square_mm)
    found = np.full((len(corners), _N_FOUND), np.nan)
    board_from_picture = np.asarray(np.linalg.inv(homographies), np.float64)
    _align(
        shown.picture, shown.clipped, shown.cell, int(shown.cell.max()) + 1, pattern, texels_per_mm,
        board_from_picture, predicted, _bend(lens, predicted), reach, found,
    )  # fmt: skip
    covariance = found[:, [2, 3, 3, 4]].reshape(-1, 2, 2)
    return Aligned(found[:, :2], covariance, found[:, 5], found[:, 6], found[:, 7])


def project(homographies: Array, points: Array) -> Array:
    """Map points (n, 2), each by its homography (n, 3, 3)."""
    mapped = np.einsum("nij,nj->ni", homographies, np.concatenate([points, np.ones((len(points), 1))], axis=1))
    return np.asarray(mapped[:, :2] / mapped[:, 2:])


def _bend(lens: Lens | None, at: Array) -> Array:
    """Return, near each place u_0 of a picture, the ideal pixel as a quadratic in u - u_0.

    Shape (n, 2, 6): factors of 1, du, dv, du^2, du dv, dv^2.
    """
    bend = np.zeros((len(at), 2, 6))
    bend[:, 0, 1] = bend[:, 1, 2] = 1.0
    bend[..., 0] = at
    if lens is not None:
        h = float(_LARGEST)
        step = h * np.array([[i, j] for j in (-1, 0, 1) for i in (-1, 0, 1)], np.float64)
        A = np.stack([np.ones(9), *step.T, step[:, 0] ** 2, step[:, 0] * step[:, 1], step[:, 1] ** 2], axis=1)
        seen = lens.undistort((at[:, None] + step).reshape(-1, 2)).reshape(len(at), 9, 2)
        bend = np.swapaxes(np.linalg.pinv(A) @ seen, 1, 2)
    return np.ascontiguousarray(bend)


def _reach(homographies: Array, corners: Array, here: Array, square_mm: float) -> NDArray[np.int64]:
    """Return how many pixels each patch reaches to each side: over half a square, short of the next corner."""
    along = [project(homographies, corners + square_mm * np.array(axis)) - here for axis in ((1.0, 0.0), (0.0, 1.0))]
    shortest = np.min([np.linalg.norm(step, axis=1) for step in along], axis=0)
    return np.asarray(np.clip(np.floor(0.6 * shortest), _SMALLEST, _LARGEST), np.int64)


@njit(cache=True, nogil=True, parallel=True)
def _align(
    picture: NDArray[np.float32], clipped: NDArray[np.bool_], cell: NDArray[np.int64], n_channels: int,
    pattern: NDArray[np.float32], texels_per_mm: float, board_from_picture: Array, predicted: Array, bend: Array,
    reach: NDArray[np.int64], found: Array,
) -> None:  # fmt: skip
    for k in prange(len(predicted)):
        _align_one(
            picture,
            clipped,
            cell,
            n_channels,
            pattern,
            texels_per_mm,
            board_from_picture[k],
            predicted[k],
            bend[k],
            reach[k],
            found[k],
        )


@njit(cache=True, nogil=True)
def _align_one(
    picture: NDArray[np.float32], clipped: NDArray[np.bool_], cell: NDArray[np.int64], n_channels: int,
    pattern: NDArray[np.float32], texels_per_mm: float, board_from_picture: Array, predicted: Array, bend: Array,
    r: int, found: Array,
) -> None:  # fmt: skip
    n = 2 * r + 1
    column, row = int(np.rint(predicted[0])), int(np.rint(predicted[1]))
    if not (r <= column < picture.shape[1] - r and r <= row < picture.shape[0] - r):
        return
    fine = np.empty((SUBSAMPLES * (n + 2 * _MARGIN), SUBSAMPLES * (n + 2 * _MARGIN)))
    shown = np.empty((4, n, n))
    here = (slice(row - r, row + r + 1), slice(column - r, column + r + 1))
    patch, bound = picture[here], clipped[here]
    channel = np.empty((n, n), np.int64)
    for i in range(n):
        for j in range(n):
            channel[i, j] = cell[(row - r + i) & 1, (column - r + j) & 1]
    N, x = np.zeros((2 * n_channels + 5, 2 * n_channels + 5)), np.zeros(2 * n_channels + 5)
    dx, dy, blur, noise = 0.0, 0.0, _START_BLUR, 0.0
    for _ in range(_ROUNDS):
        left, top = column - r - dx - predicted[0], row - r - dy - predicted[1]
        _sample_pattern(pattern, texels_per_mm, board_from_picture, bend, left, top, fine)
        _show(fine, blur, shown)
        noise = _fit(patch, bound, channel, n_channels, shown, N, x)
        dx, dy = dx + x[-3], dy + x[-2]
        blur = min(max(blur + x[-1], _MIN_BLUR), _MAX_BLUR)
        if not (abs(dx) <= _MAX_SHIFT and abs(dy) <= _MAX_SHIFT):
            return
    covariance = np.linalg.inv(N)[-3:-1, -3:-1] * noise
    contrast = x[n_channels : 2 * n_channels].mean()
    found[0], found[1] = predicted[0] + dx, predicted[1] + dy
    found[2], found[3], found[4] = covariance[0, 0], covariance[0, 1], covariance[1, 1]
    found[5], found[6], found[7] = np.sqrt(noise) / max(abs(contrast), 1e-30), contrast, blur


@njit(cache=True, nogil=True)
def _sample_pattern(
    pattern: NDArray[np.float32], texels_per_mm: float, board_from_picture: Array, bend: Array, left: float, top: float,
    out: Array,
) -> None:  # fmt: skip
    """Sample the pattern `SUBSAMPLES` times a pixel, bilinear; (left, top) is the way to the first pixel inside."""
    B = board_from_picture
    rows, columns = pattern.shape
    for i in range(out.shape[0]):
        dv = top - _MARGIN - 0.5 + (i + 0.5) / SUBSAMPLES
        for j in range(out.shape[1]):
            du = left - _MARGIN - 0.5 + (j + 0.5) / SUBSAMPLES
            u = bend[0, 0] + du * (bend[0, 1] + bend[0, 3] * du + bend[0, 4] * dv) + dv * (bend[0, 2] + bend[0, 5] * dv)
            v = bend[1, 0] + du * (bend[1, 1] + bend[1, 3] * du + bend[1, 4] * dv) + dv * (bend[1, 2] + bend[1, 5] * dv)
            w = B[2, 0] * u + B[2, 1] * v + B[2, 2]
            x = (B[0, 0] * u + B[0, 1] * v + B[0, 2]) / w * texels_per_mm - 0.5
            y = (B[1, 0] * u + B[1, 1] * v + B[1, 2]) / w * texels_per_mm - 0.5
            if not (0.0 <= x < columns - 1 and 0.0 <= y < rows - 1):
                out[i, j] = 1.0  # what surrounds a board is paper
                continue
            a, b = int(x), int(y)
            s, t = x - a, y - b
            out[i, j] = (1 - t) * ((1 - s) * pattern[b, a] + s * pattern[b, a + 1]) + t * (
                (1 - s) * pattern[b + 1, a] + s * pattern[b + 1, a + 1]
            )


@njit(cache=True, nogil=True)
def _show(fine: Array, blur: float, shown: Array) -> None:
    """Write T, dT/dx, dT/dy and Laplace T of each pixel: averaged over it and blurred by a Gaussian."""
    S, n, n_fine = SUBSAMPLES, shown.shape[1], fine.shape[0]
    n_taps = S * (2 * _MARGIN + 1)
    taps = np.empty((3, n_taps))
    sigma = np.sqrt(blur)
    for m in range(n_taps):
        t = (m + 0.5) / S - _MARGIN - 0.5
        high, low = (t + 0.5) / sigma, (t - 0.5) / sigma
        gauss_high, gauss_low = np.exp(-0.5 * high * high), np.exp(-0.5 * low * low)
        taps[0, m] = 0.5 * (math.erf(high / math.sqrt(2.0)) - math.erf(low / math.sqrt(2.0))) / S
        taps[1, m] = -(gauss_high - gauss_low) / (sigma * math.sqrt(2.0 * math.pi)) / S
        taps[2, m] = -(high * gauss_high - low * gauss_low) / (blur * math.sqrt(2.0 * math.pi)) / S
    along = np.zeros((3, n_fine, n))
    for i in range(n_fine):
        for j in range(n):
            for m in range(n_taps):
                value = fine[i, S * j + m]
                for q in range(3):
                    along[q, i, j] += taps[q, m] * value
    shown[:] = 0.0
    for i in range(n):
        for m in range(n_taps):
            row = S * i + m
            for j in range(n):
                shown[0, i, j] += taps[0, m] * along[0, row, j]
                shown[1, i, j] += taps[0, m] * along[1, row, j]
                shown[2, i, j] += taps[1, m] * along[0, row, j]
                shown[3, i, j] += taps[0, m] * along[2, row, j] + taps[2, m] * along[0, row, j]


@njit(cache=True, nogil=True)
def _fit(
    patch: NDArray[np.float32], bound: NDArray[np.bool_], channel: NDArray[np.int64], n_channels: int, shown: Array,
    N: Array, x: Array,
) -> float:  # fmt: skip
    """Least squares for x = (a, b, g, d, s) with normal matrix N; returns the variance of the residual.

    A first solution without d and s gives the contrasts that the columns of d and s are scaled with. What a bound is
    held against is the light of the solution before, at first none.
    """
    n, n_light = patch.shape[0], 2 * n_channels + 2
    n_all = n_light + 3
    y, row, light = np.zeros(n_all), np.zeros(n_all), np.zeros(n_light)
    total, count = 0.0, 0
    for stage in range(2):
        size = n_light if stage == 0 else n_all
        N[:], y[:] = 0.0, 0.0
        total, count = 0.0, 0
        light[:] = x[:n_light]
        for i in range(n):
            for j in range(n):
                value = patch[i, j]
                if not np.isfinite(value):
                    continue
                c, T = channel[i, j], shown[0, i, j]
                row[:] = 0.0
                row[c], row[n_channels + c] = 1.0, T
                row[n_light - 2], row[n_light - 1] = (j - 0.5 * (n - 1)) / n * T, (i - 0.5 * (n - 1)) / n * T
                if bound[i, j] and np.dot(row[:n_light], light) >= value:
                    continue
                if stage == 1:
                    b = x[n_channels + c]
                    row[n_light], row[n_light + 1] = -b * shown[1, i, j], -b * shown[2, i, j]
                    row[n_light + 2] = 0.5 * b * shown[3, i, j]
                for p in range(size):
                    y[p] += row[p] * value
                    for q in range(p + 1):
                        N[p, q] += row[p] * row[q]
                total += value * value
                count += 1
        for p in range(size):
            N[p, p] += 1e-9 * N[p, p] + 1e-30
            for q in range(p):
                N[q, p] = N[p, q]
        x[:] = 0.0
        x[:size] = np.linalg.solve(N[:size, :size], y[:size])
    return float(max(total - np.dot(x, y), 0.0) / max(count - n_all, 1))
