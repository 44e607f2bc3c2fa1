"""Least squares over pairs of neighbours: conjugate gradients that one multigrid cycle preconditions.

For heights z on a grid, increments g along pairs and weights w of the pairs,

    sum w (z_b - z_a - g)^2

is least where A z = D^T w g, A = D^T w D. A coarser level joins 2 x 2 pixels into one: its pairs are
the sums of the fine pairs that cross between blocks, so holes and contrasts of the weights come along by
themselves. Steps of a piecewise constant correction are twice too stiff in two dimensions; halving the coarse
weights makes up for it [braess1995]. The smoother is red-black Gauss-Seidel, mirrored after the correction so
that the cycle is symmetric. One thread: the bits are the same on any machine load.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.compiling import njit

Array = NDArray[np.float64]

MIN_LEVEL = 64
"""Pixels at which a level is solved by its dense inverse."""

OVERCORRECTION = 0.5
"""Factor on the weights of the coarser level; 0.45 to 0.6 differ by a few iterations."""

MAX_ITERATIONS = 500


@dataclass(frozen=True)
class Level:
    """One grid of the hierarchy.

    Attributes
    ----------
    w_x, w_y : ndarray, shape (height, width)
        Weight of the pair with the pixel to the right, and below; 0 in the last column, or row.
    diagonal, inverse : ndarray, shape (height, width)
        Diagonal of A, and one over it (0 where a pixel has no weight at all).
    """

    w_x: Array
    w_y: Array
    diagonal: Array
    inverse: Array


class PairSystem:
    """A z = b, ready to be solved for right-hand sides b of shape (height, width)."""

    def __init__(self, w_x: Array, w_y: Array) -> None:
        levels = [_level(w_x, w_y)]
        while levels[-1].w_x.size > MIN_LEVEL:
            levels.append(_coarser(levels[-1]))
        self.levels = levels
        self._coarsest = np.linalg.pinv(_dense(levels[-1]), rcond=1e-12, hermitian=True)

    def solve(self, b: Array, tolerance: float) -> Array:
        """Return z; `tolerance` is that of the preconditioned residual's norm, relative to the one at z = 0.

        What the weights leave free, the mean of each part, is arbitrary. After
        `MAX_ITERATIONS` it is the best so far.
        """
        zero = np.zeros_like(b)
        z, p, r = zero.copy(), zero.copy(), b.copy()
        rho, first = np.inf, 0.0
        for _ in range(MAX_ITERATIONS):
            y = self.cycle(r)
            previous, rho = rho, _dot(r, y)
            first = first or rho
            if not rho > tolerance**2 * first:
                break
            p *= rho / previous
            p += y
            q = self.residual(p, zero)  # -A p
            alpha = -rho / _dot(p, q)
            z += alpha * p
            r += alpha * q
        return z

    def right_side(self, g_x: Array, g_y: Array) -> Array:
        """Return b = D^T w g."""
        level = self.levels[0]
        a_x, a_y = level.w_x * g_x, level.w_y * g_y
        b = -a_x - a_y
        b[:, 1:] += a_x[:, :-1]
        b[1:] += a_y[:-1]
        return np.asarray(b)

    def residual(self, z: Array, b: Array, i_level: int = 0) -> Array:
        """Return b - A z."""
        level, r = self.levels[i_level], b.copy()
        _subtract_product(z, level.w_x, level.w_y, level.diagonal, r)
        return r

    def cycle(self, b: Array, i_level: int = 0) -> Array:
        """Approximate A^-1 b by one V-cycle: symmetric and positive, so it may precondition."""
        level = self.levels[i_level]
        if level is self.levels[-1]:
            return np.asarray((self._coarsest @ b.ravel()).reshape(b.shape))
        z = np.zeros_like(b)
        for colour in (0, 1):
            _relax(z, b, level.w_x, level.w_y, level.inverse, colour)
        _add_coarse(z, self.cycle(_block_sums(self.residual(z, b, i_level)), i_level + 1))
        for colour in (1, 0):
            _relax(z, b, level.w_x, level.w_y, level.inverse, colour)
        return z


def _level(w_x: Array, w_y: Array) -> Level:
    diagonal = w_x + w_y
    diagonal[:, 1:] += w_x[:, :-1]
    diagonal[1:] += w_y[:-1]
    inverse = np.where(diagonal > 0.0, 1.0 / np.where(diagonal > 0.0, diagonal, 1.0), 0.0)
    return Level(w_x, w_y, diagonal, inverse)


def _coarser(fine: Level) -> Level:
    # A block's own pairs join nothing on the coarser level: only odd columns (rows) lead to the next block.
    w_x, w_y = fine.w_x.copy(), fine.w_y.copy()
    w_x[:, ::2] = 0.0
    w_y[::2] = 0.0
    return _level(OVERCORRECTION * _block_sums(w_x), OVERCORRECTION * _block_sums(w_y))


def _dense(level: Level) -> Array:
    height, width = level.w_x.shape
    index = np.arange(height * width).reshape(height, width)
    A = np.diag(level.diagonal.ravel())
    for a, b, w in (
        (index[:, :-1], index[:, 1:], level.w_x[:, :-1]),
        (index[:-1], index[1:], level.w_y[:-1]),
    ):
        A[a, b] = A[b, a] = -w
    return A


def _dot(a: Array, b: Array) -> float:
    # Pairwise sums in numpy's own order, where BLAS would depend on the number of threads.
    return float(np.sum(a * b))


@njit(cache=True, nogil=True)
def _relax(z: Array, b: Array, w_x: Array, w_y: Array, inverse: Array, colour: int) -> None:
    height, width = z.shape
    for i in range(height):
        for j in range((i + colour) % 2, width, 2):
            total = b[i, j]
            if j > 0:
                total += w_x[i, j - 1] * z[i, j - 1]
            if j < width - 1:
                total += w_x[i, j] * z[i, j + 1]
            if i > 0:
                total += w_y[i - 1, j] * z[i - 1, j]
            if i < height - 1:
                total += w_y[i, j] * z[i + 1, j]
            z[i, j] = total * inverse[i, j]


@njit(cache=True, nogil=True)
def _subtract_product(z: Array, w_x: Array, w_y: Array, diagonal: Array, r: Array) -> None:
    """Take A z off r."""
    height, width = z.shape
    for i in range(height):
        for j in range(width):
            total = diagonal[i, j] * z[i, j]
            if j > 0:
                total -= w_x[i, j - 1] * z[i, j - 1]
            if j < width - 1:
                total -= w_x[i, j] * z[i, j + 1]
            if i > 0:
                total -= w_y[i - 1, j] * z[i - 1, j]
            if i < height - 1:
                total -= w_y[i, j] * z[i + 1, j]
            r[i, j] -= total


@njit(cache=True, nogil=True)
def _block_sums(a: Array) -> Array:
    """Return the sums over blocks of 2 x 2 pixels, of fewer at the end of an odd side."""
    height, width = a.shape
    sums = np.zeros(((height + 1) // 2, (width + 1) // 2))
    for i in range(height):
        for j in range(width):
            sums[i // 2, j // 2] += a[i, j]
    return sums


@njit(cache=True, nogil=True)
def _add_coarse(z: Array, coarse: Array) -> None:
    for i in range(z.shape[0]):
        for j in range(z.shape[1]):
            z[i, j] += coarse[i // 2, j // 2]
