"""The kernel of the rectification: a quadratic fitted to each colour's samples under a Gaussian footprint.

Points are worked on `LANES` at a time, in step: every step of the fit is a loop over the lanes, which the compiler
turns into vector instructions, and samples of one place of the colour cell stand in the same slot for all lanes.
Slots that lie outside a lane's footprint have the weight 0. A lane's arithmetic does not depend on its
neighbours, so that tiles of any size give the same bits.
"""

from __future__ import annotations

import numpy as np
from numba import prange
from numpy.typing import NDArray

from analysis.camera.view import in_camera, project
from analysis.compiling import njit

Array = NDArray[np.float64]

Array32 = NDArray[np.float32]

SENSOR_SIGMA_PX = 1.1
"""Least footprint: a colour that fills one pixel in four needs this much to hold a quadratic."""

LANES = 128

# Footprint's radius in sigmas; what lies beyond has 2 % of the peak weight. At the least footprint it is just
# over 3 pixels: less, and some places see two columns of a colour only, to which no quadratic can be fitted.
_REACH = 2.8

# Of a value, from clipped samples, that leaves it a value. The weight alone would not do: a clipped sample may be
# a hundred times as bright as its neighbours.
_CLIPPED_SHARE = 0.02

# Rows of a block's table of lanes.
_X, _Y, _REACH_X, _REACH_Y, _IXX, _IXY, _IYY = range(7)

# Exponents of dx and dy in the basis 1, dx, dy, dx^2, dx dy, dy^2.
_POWERS = ((0, 0), (1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


@njit(cache=True, nogil=True)
def _footprint(
    point: Array, pitch: float, rotation: Array, translation: Array, matrix: Array
) -> tuple[float, float, float]:
    """Covariance in the picture, pixels squared: a box of one grid pixel (1/12 per axis) and the sensor's own.

    Distortion is left out: it changes the size of a footprint by less than a percent.
    """
    x, y, z = in_camera(point, rotation, translation)
    sxx, sxy, syy = SENSOR_SIGMA_PX**2, 0.0, SENSOR_SIGMA_PX**2
    for axis in range(2):
        along_u = pitch * matrix[0, 0] / z * (rotation[0, axis] - x / z * rotation[2, axis])
        along_v = pitch * matrix[1, 1] / z * (rotation[1, axis] - y / z * rotation[2, axis])
        sxx += along_u * along_u / 12.0
        sxy += along_u * along_v / 12.0
        syy += along_v * along_v / 12.0
    return sxx, sxy, syy


@njit(cache=True, nogil=True, parallel=True)
def gather(
    pictures: Array32,
    signed_variance: Array32,
    cell: NDArray[np.int64],
    points: Array,
    pitch: float,
    rotation: Array,
    translation: Array,
    matrix: Array,
    distortion: Array,
) -> tuple[Array32, Array32, NDArray[np.uint8], Array]:
    """Return radiance, variance and clipped (P, n_channels), and pixels (P, 2), of `points` (P, 3).

    Parameters
    ----------
    pictures : ndarray of float32, shape (n_planes, height, width)
        One plane, a mosaic of the colours of `cell`; or one plane a channel, and a cell of zeros.
    signed_variance : ndarray of float32, shape (n_planes, height, width)
        Its sign bit is set where the picture is clipped.
    """
    n_points = points.shape[0]
    n_planes, height, width = pictures.shape
    n_fits = cell.max() + 1
    n_channels = n_fits * n_planes
    radiance = np.full((n_points, n_channels), np.nan, np.float32)
    noise = np.full((n_points, n_channels), np.nan, np.float32)
    clipped = np.zeros((n_points, n_channels), np.uint8)
    pixels = np.empty((n_points, 2))
    for block in prange((n_points + LANES - 1) // LANES):
        first, last = block * LANES, min((block + 1) * LANES, n_points)
        lanes, seen = np.ones((7, LANES)), np.zeros(LANES, np.bool_)
        for p in range(first, last):
            lane = p - first
            pixels[p] = project(points[p], rotation, translation, matrix, distortion)
            sxx, sxy, syy = _footprint(points[p], pitch, rotation, translation, matrix)
            seen[lane] = _place(pixels[p, 0], pixels[p, 1], sxx, sxy, syy, width, height, lanes[:, lane])
        if not seen.any():
            continue
        n_x, n_y = int(lanes[_REACH_X].max()) + 1, int(lanes[_REACH_Y].max()) + 1
        weight = np.empty((2 * n_y, 2 * n_x, LANES))
        _weigh(lanes, weight)
        solution = np.empty((n_fits, 6, LANES))
        for fit in range(n_fits):
            _solve(_moments(lanes, weight, cell, fit), solution[fit])
        value, variance, clip = np.empty(LANES), np.empty(LANES), np.empty(LANES)
        for channel in range(n_channels):
            fit, plane = channel % n_fits, channel // n_fits
            _apply(
                lanes, weight, cell, fit, solution[fit], pictures[plane], signed_variance[plane], value, variance, clip
            )
            for p in range(first, last):
                if seen[p - first]:
                    radiance[p, channel], noise[p, channel] = value[p - first], variance[p - first]
                    clipped[p, channel] = clip[p - first] > _CLIPPED_SHARE * abs(value[p - first])
    return radiance, noise, clipped, pixels


@njit(cache=True, nogil=True)
def _place(
    x: float, y: float, sxx: float, sxy: float, syy: float, width: int, height: int, lane: Array
) -> bool:  # fmt: skip
    """Write where a lane's footprint lies and its inverse covariance; tell whether the picture holds all of it."""
    reach_x, reach_y = _REACH * np.sqrt(sxx), _REACH * np.sqrt(syy)
    if not (x - reach_x >= 0 and x + reach_x < width and y - reach_y >= 0 and y + reach_y < height):
        return False
    determinant = sxx * syy - sxy * sxy
    lane[_X], lane[_Y], lane[_REACH_X], lane[_REACH_Y] = x, y, reach_x, reach_y
    lane[_IXX], lane[_IXY], lane[_IYY] = syy / determinant, -sxy / determinant, sxx / determinant
    return True


@njit(cache=True, nogil=True)
def _firsts(lanes: Array) -> tuple[Array, Array]:
    """Return where the first samples in reach stand whose index is even, and odd, from the centre, (2, LANES) each."""
    first_x, first_y = np.empty((2, LANES)), np.empty((2, LANES))
    for parity in range(2):
        _first(lanes[_X], lanes[_REACH_X], parity, first_x[parity])
        _first(lanes[_Y], lanes[_REACH_Y], parity, first_y[parity])
    return first_x, first_y


@njit(cache=True, nogil=True)
def _first(x: Array, reach: Array, parity: int, out: Array) -> None:
    for lane in range(LANES):
        start = np.ceil(x[lane] - reach[lane])
        odd = start - 2.0 * np.floor(0.5 * start)
        out[lane] = start + np.abs(odd - parity) - x[lane]


@njit(cache=True, nogil=True, fastmath={"contract"})
def _weigh(lanes: Array, weight: Array) -> None:
    """Write the Gaussian of each sample: slot (r, c) is of parity r % 2, c % 2, the (r // 2, c // 2)-th in reach."""
    n_rows, n_columns = weight.shape[:2]
    reach_x, reach_y = lanes[_REACH_X], lanes[_REACH_Y]
    ixx, ixy, iyy = lanes[_IXX], lanes[_IXY], lanes[_IYY]
    first_x, first_y = _firsts(lanes)
    for r in range(n_rows):
        from_y = first_y[r % 2]
        for c in range(n_columns):
            _gaussian(first_x[c % 2], from_y, c // 2 * 2.0, r // 2 * 2.0, reach_x, reach_y, ixx, ixy, iyy, weight[r, c])


@njit(cache=True, nogil=True, fastmath={"contract"})
def _gaussian(
    first_x: Array, first_y: Array, right: float, down: float, reach_x: Array, reach_y: Array,
    ixx: Array, ixy: Array, iyy: Array, out: Array,
) -> None:  # fmt: skip
    for lane in range(LANES):
        dx, dy = first_x[lane] + right, first_y[lane] + down
        # exp(z) = exp(z / 256)^256, the root by its series: to 1e-11 where the weight counts, and no function to call.
        z = max(-0.5 * (dx * (ixx[lane] * dx + 2.0 * ixy[lane] * dy) + iyy[lane] * dy * dy), -200.0) * (1 / 256)
        e = 1.0 + z * (1.0 + z * (1 / 2 + z * (1 / 6 + z * (1 / 24 + z * (1 / 120 + z * (1 / 720))))))
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        e *= e
        out[lane] = e if dx <= reach_x[lane] and dy <= reach_y[lane] else 0.0


@njit(cache=True, nogil=True, fastmath={"contract"})
def _moments(lanes: Array, weight: Array, cell: NDArray[np.int64], fit: int) -> Array:
    """Return sum w dx^a dy^b, a + b <= 4, over the samples of one colour, shape (15 * LANES,).

    The place of a power is (a + b)(a + b + 1) / 2 + b.
    """
    first_x, first_y = _firsts(lanes)
    out, row = np.zeros(15 * LANES), np.empty(5 * LANES)
    for r in range(weight.shape[0]):
        row[:] = 0.0
        for c in range(weight.shape[1]):
            if cell[r % 2, c % 2] == fit:
                _add_sample(first_x[c % 2], c // 2 * 2.0, weight[r, c], row)
        _add_row(first_y[r % 2], r // 2 * 2.0, row, out)
    return out


@njit(cache=True, nogil=True, fastmath={"contract"})
def _add_sample(first_x: Array, right: float, weight: Array, row: Array) -> None:
    """Add w dx^a, a = 0 to 4, of one slot."""
    for lane in range(LANES):
        dx = first_x[lane] + right
        w0 = weight[lane]
        w1 = w0 * dx
        w2 = w1 * dx
        w3 = w2 * dx
        row[lane] += w0
        row[LANES + lane] += w1
        row[2 * LANES + lane] += w2
        row[3 * LANES + lane] += w3
        row[4 * LANES + lane] += w3 * dx


@njit(cache=True, nogil=True, fastmath={"contract"})
def _add_row(first_y: Array, down: float, row: Array, out: Array) -> None:
    """Add the sums of one row of samples, times dy^b."""
    for lane in range(LANES):
        dy = first_y[lane] + down
        dy2 = dy * dy
        s0, s1, s2 = row[lane], row[LANES + lane], row[2 * LANES + lane]
        s3, s4 = row[3 * LANES + lane], row[4 * LANES + lane]
        out[lane] += s0
        out[LANES + lane] += s1
        out[2 * LANES + lane] += s0 * dy
        out[3 * LANES + lane] += s2
        out[4 * LANES + lane] += s1 * dy
        out[5 * LANES + lane] += s0 * dy2
        out[6 * LANES + lane] += s3
        out[7 * LANES + lane] += s2 * dy
        out[8 * LANES + lane] += s1 * dy2
        out[9 * LANES + lane] += s0 * dy2 * dy
        out[10 * LANES + lane] += s4
        out[11 * LANES + lane] += s3 * dy
        out[12 * LANES + lane] += s2 * dy2
        out[13 * LANES + lane] += s1 * dy2 * dy
        out[14 * LANES + lane] += s0 * dy2 * dy2


@njit(cache=True, nogil=True, fastmath={"contract"})
def _solve(moments: Array, out: Array) -> None:
    """Solve M s = (1, 0, ..., 0) by Cholesky: s . basis is what a sample adds to the fitted value.

    M holds the products of the basis, each of them one moment. Where a colour has too few samples for a
    quadratic, s gives their weighted mean.
    """
    M = np.empty((6, 6, LANES))
    peak = moments[:LANES]
    for i in range(6):
        for j in range(i + 1):
            b = _POWERS[i][1] + _POWERS[j][1]
            n = _POWERS[i][0] + _POWERS[j][0] + b
            start = (n * (n + 1) // 2 + b) * LANES
            M[i, j] = moments[start : start + LANES]
            for k in range(j):
                _subtract_product(M[i, k], M[j, k], M[i, j])
            if i == j:
                _root(peak, M[i, i])
            else:
                M[i, j] *= M[j, j]
    # The diagonal holds reciprocals.
    for i in range(6):
        out[i] = 1.0 if i == 0 else 0.0
        for k in range(i):
            _subtract_product(M[i, k], out[k], out[i])
        out[i] *= M[i, i]
    for i in range(5, -1, -1):
        for k in range(i + 1, 6):
            _subtract_product(M[k, i], out[k], out[i])
        out[i] *= M[i, i]
    for lane in range(LANES):
        if not np.isfinite(out[0, lane]):
            out[:, lane] = 0.0
            out[0, lane] = 1.0 / max(peak[lane], 1e-300)


@njit(cache=True, nogil=True, fastmath={"contract"})
def _subtract_product(a: Array, b: Array, out: Array) -> None:
    for lane in range(LANES):
        out[lane] -= a[lane] * b[lane]


@njit(cache=True, nogil=True)
def _root(peak: Array, pivot: Array) -> None:
    """Replace a pivot by the reciprocal of its root, or by NaN where there is none."""
    for lane in range(LANES):
        pivot[lane] = 1.0 / np.sqrt(pivot[lane]) if pivot[lane] > 1e-6 * peak[lane] else np.nan


@njit(cache=True, nogil=True, fastmath={"contract"})
def _apply(
    lanes: Array, weight: Array, cell: NDArray[np.int64], fit: int, solution: Array,
    picture: Array32, signed_variance: Array32, value: Array, variance: Array, clip: Array,
) -> None:  # fmt: skip
    """Write the fitted value of each lane, its variance, and the sum of what clipped samples add, without signs."""
    value[:], variance[:], clip[:] = 0.0, 0.0, 0.0
    first_x, first_y = _firsts(lanes)
    factor, start = np.empty(LANES), np.empty((2, 2, LANES), np.int64)
    width = picture.shape[1]
    for place in range(4):
        row, column = place // 2, place % 2
        _start(lanes, first_x[column], first_y[row], width, start[row, column])
    samples, variances = picture.reshape(-1), signed_variance.reshape(-1)
    for r in range(weight.shape[0]):
        for c in range(weight.shape[1]):
            if cell[r % 2, c % 2] != fit:
                continue
            _factor(first_x[c % 2], first_y[r % 2], c // 2 * 2.0, r // 2 * 2.0, weight[r, c], solution, factor)
            further = r // 2 * 2 * width + c // 2 * 2
            _add_samples(factor, start[r % 2, c % 2], further, samples, variances, value, variance, clip)


@njit(cache=True, nogil=True)
def _start(lanes: Array, first_x: Array, first_y: Array, width: int, out: NDArray[np.int64]) -> None:
    """Write the flat index of each lane's first sample of one place."""
    for lane in range(LANES):
        out[lane] = int(first_y[lane] + lanes[_Y, lane] + 0.5) * width + int(first_x[lane] + lanes[_X, lane] + 0.5)


@njit(cache=True, nogil=True, fastmath={"contract"})
def _add_samples(
    factor: Array, start: NDArray[np.int64], further: int, samples: Array32, variances: Array32,
    value: Array, variance: Array, clip: Array,
) -> None:  # fmt: skip
    for lane in range(LANES):
        # Out of reach: not even read, since it may lie outside the picture or be NaN.
        if factor[lane] == 0.0:
            continue
        var = variances[start[lane] + further]
        light = factor[lane] * samples[start[lane] + further]
        value[lane] += light
        variance[lane] += factor[lane] * factor[lane] * abs(var)
        if np.copysign(1.0, var) < 0.0:
            clip[lane] += abs(light)


@njit(cache=True, nogil=True, fastmath={"contract"})
def _factor(
    first_x: Array, first_y: Array, right: float, down: float, weight: Array, solution: Array, out: Array
) -> None:  # fmt: skip
    """Write what a unit of the sample in one slot adds to the fitted value."""
    for lane in range(LANES):
        dx, dy = first_x[lane] + right, first_y[lane] + down
        out[lane] = weight[lane] * (
            solution[0, lane]
            + dx * (solution[1, lane] + solution[3, lane] * dx + solution[4, lane] * dy)
            + dy * (solution[2, lane] + solution[5, lane] * dy)
        )
