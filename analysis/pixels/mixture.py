"""Shares of few materials that all channels have in common: non-negative least squares of one pixel with a palette.

A palette has few materials and a pixel many rows, so the rows are gone through once, and all choices are made on
the products between columns: which materials a pixel is made of is then found exactly, not by trial.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.kernel import fast_kernel, kernel
from analysis.pixels.nnls import Indices, Work, solve_active

_COPY = 1e-9  # share of a column's square that others must leave of it, or it is their copy to rounding

Array = NDArray[np.float64]

Array32 = NDArray[np.float32]


class Mixture(NamedTuple):
    """Scratch of one pixel: columns of all K materials over R rows, and products between them."""

    column: NDArray[np.float64]  # [K, R]
    gram: NDArray[np.float64]  # [K, K] weighted products of the columns
    right: NDArray[np.float64]  # [K] weighted products with the target


@kernel
def allocate_mixture(n_materials: int, n_rows: int) -> Mixture:
    """Allocate the scratch."""
    return Mixture(np.zeros((n_materials, n_rows)), np.zeros((n_materials, n_materials)), np.zeros(n_materials))


@fast_kernel
def fill_column(table: Array32, k: int, node: Indices, beyond: Array, shade: Array, column: Array) -> None:
    """Write s_v F_kc(t_v) of material k, channel by channel, one row more a channel than views."""
    n_views = node.shape[0]
    for ch in range(table.shape[0]):
        row = ch * (n_views + 1)
        for v in range(n_views):
            low, high = table[ch, node[v], k], table[ch, node[v] + 1, k]
            column[row + v] = shade[v] * (low + beyond[v] * (high - low))


@kernel
def choose(
    w: Array, y: Array, tolerance: float, most: int, active: Indices, a: Array, work: Work, mixture: Mixture
) -> int:
    """Weighted non-negative least squares on at most three columns of `mixture`: those that fit best of all.

    Parameters
    ----------
    w, y : ndarray, shape (R,)
    tolerance : float
        Smallest gain in the weighted sum of squares for which a material more is taken.
    most : int
        Most materials, at most 3.
    active, a : ndarray, shape (MAX_ATOMS,)
        Their indices and shares are written here.
    work : Work
        On return its columns, G and L are those of the solution.
    mixture : Mixture
        With its columns filled.

    Returns
    -------
    int
        The number of materials taken.
    """
    _reduce(w, y, mixture.column, mixture.gram, mixture.right)
    gain, best = np.zeros(4), np.zeros((4, 3), np.int64)
    _best_sets(most, mixture, gain, best)
    m = 0
    for size in range(1, most + 1):
        if gain[size] - gain[m] > tolerance * (size - m):
            m = size
    for j in range(m):
        active[j], a[j] = best[m, j], 0.0
        work.columns[j] = mixture.column[active[j]]
        work.b[j] = mixture.right[active[j]]
        for i in range(m):
            work.G[j, i] = mixture.gram[active[j], best[m, i]]
    return solve_active(m, active, a, work.columns, work.G, work.b, work.L, work.x)


@fast_kernel
def _reduce(w: Array, y: Array, column: Array, gram: Array, right: Array) -> None:
    """Write the weighted products of all columns with each other and with the target."""
    for k in range(column.shape[0]):
        total = 0.0
        for row in range(w.shape[0]):
            total += w[row] * column[k, row] * y[row]
        right[k] = total
        for i in range(k + 1):
            total = 0.0
            for row in range(w.shape[0]):
                total += w[row] * column[k, row] * column[i, row]
            gram[k, i] = total
            gram[i, k] = total


@kernel
def _best_sets(most: int, mixture: Mixture, gain: Array, best: NDArray[np.int64]) -> None:
    """Find the one, two and three materials that fit best, all with positive shares.

    What a set takes off the sum of squares is b'a with a the solution of G a = b; materials enter a set one after
    the other by their Schur complements. With a dozen materials there are 298 sets, which takes less time than going
    through the rows once.
    """
    G, b = mixture.gram, mixture.right
    for i in range(b.shape[0]):
        if not (b[i] > 0.0 and G[i, i] > 1e-30):
            continue
        one = b[i] * b[i] / G[i, i]
        if one > gain[1]:
            gain[1], best[1, 0] = one, i
    for i in range(b.shape[0] if most > 1 else 0):
        for j in range(i):
            d = G[i, i] * G[j, j] - G[i, j] * G[i, j]
            if not d > _COPY * G[i, i] * G[j, j]:
                continue
            x, y = (G[j, j] * b[i] - G[i, j] * b[j]) / d, (G[i, i] * b[j] - G[i, j] * b[i]) / d
            if x > 0.0 and y > 0.0 and x * b[i] + y * b[j] > gain[2]:
                gain[2], best[2, 0], best[2, 1] = x * b[i] + y * b[j], i, j
            for k in range(j if most > 2 else 0):
                p = (G[j, j] * G[i, k] - G[i, j] * G[j, k]) / d
                q = (G[i, i] * G[j, k] - G[i, j] * G[i, k]) / d
                rest = G[k, k] - p * G[i, k] - q * G[j, k]
                z = b[k] - p * b[i] - q * b[j]
                if not (z > 0.0 and rest > _COPY * G[k, k]):
                    continue
                z /= rest
                u, v = x - p * z, y - q * z
                if u > 0.0 and v > 0.0 and u * b[i] + v * b[j] + z * b[k] > gain[3]:
                    gain[3], best[3, 0], best[3, 1], best[3, 2] = u * b[i] + v * b[j] + z * b[k], i, j, k


@kernel
def refit(w: Array, y: Array, m: int, active: Indices, a: Array, work: Work) -> int:
    """Weighted non-negative least squares on the active columns, which are in ``work.columns``; returns how many."""
    _reduce(w, y, work.columns[:m], work.G, work.b)
    return solve_active(m, active, a, work.columns, work.G, work.b, work.L, work.x)
