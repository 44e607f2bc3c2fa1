"""Shares of few materials that all channels have in common: non-negative least squares of one pixel with a palette.

A palette has few materials and a pixel many rows, so the rows are gone through once for each material that
comes into question, and all choices are made on the products between columns.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.kernel import fast_kernel, kernel
from analysis.nnls import MAX_ATOMS, Indices, Work, solve_active, solve_lower

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]


class Mixture(NamedTuple):
    """Scratch of one pixel: columns of all K materials over R rows, and products between them."""

    column: NDArray[np.float64]  # [K, R]
    gram: NDArray[np.float64]  # [K, K] weighted products; row k is there once material k was in question
    is_there: NDArray[np.bool_]  # [K] whether its row is
    norm2: NDArray[np.float64]  # [K] weighted squares of the columns
    right: NDArray[np.float64]  # [K] weighted products with the target


@kernel
def allocate_mixture(n_materials: int, n_rows: int) -> Mixture:
    """Allocate the scratch."""
    return Mixture(
        np.zeros((n_materials, n_rows)),
        np.zeros((n_materials, n_materials)),
        np.zeros(n_materials, np.bool_),
        np.zeros(n_materials),
        np.zeros(n_materials),
    )


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
    w: Array, y: Array, tolerance: float, most: int, m: int, active: Indices, a: Array, work: Work, mixture: Mixture
) -> int:
    """Weighted non-negative least squares on the columns of `mixture`, each of which must pay; as `nnls.nnls`.

    A material is priced with the active ones making room for it: g^2 over the Schur complement d - |L^-1 b|^2.

    Parameters
    ----------
    w, y : ndarray, shape (R,)
    tolerance, most, m, active, a, work
        As of `nnls.nnls`.
    mixture : Mixture
        With its columns filled.

    Returns
    -------
    int
        The number of active materials; columns, G and L of `work` are those of the solution.
    """
    nothing = np.zeros((MAX_ATOMS, 0))
    _reduce(w, y, mixture)
    for slot in range(m):
        _enter(w, slot, active, work, mixture)
    m = solve_active(m, active, a, nothing, work.G, work.b, work.L, work.x)
    for _ in range(3 * MAX_ATOMS):
        best = _best(tolerance, m, active, a, work, mixture) if m < most else -1
        if best < 0:
            break
        a[m], active[m] = 0.0, best
        _enter(w, m, active, work, mixture)
        m = solve_active(m + 1, active, a, nothing, work.G, work.b, work.L, work.x)
        kept = False
        for j in range(m):
            kept = kept or active[j] == best
        if not kept:
            break
    for j in range(m):
        work.columns[j] = mixture.column[active[j]]
    return m


@fast_kernel
def _reduce(w: Array, y: Array, mixture: Mixture) -> None:
    """Products of all columns with themselves and with the target."""
    for k in range(mixture.column.shape[0]):
        column = mixture.column[k]
        norm2, right = 0.0, 0.0
        for row in range(w.shape[0]):
            wc = w[row] * column[row]
            norm2 += wc * column[row]
            right += wc * y[row]
        mixture.norm2[k] = norm2
        mixture.right[k] = right
        mixture.is_there[k] = False


@fast_kernel
def _products(w: Array, k: int, mixture: Mixture) -> None:
    """Products of material k's column with all columns."""
    column, gram = mixture.column, mixture.gram
    for i in range(column.shape[0]):
        total = 0.0
        for row in range(w.shape[0]):
            total += w[row] * column[k, row] * column[i, row]
        gram[k, i] = total
    mixture.is_there[k] = True


@kernel
def _enter(w: Array, slot: int, active: Indices, work: Work, mixture: Mixture) -> None:
    """Put the material in `slot` into the equations of the active ones."""
    k = active[slot]
    if not mixture.is_there[k]:
        _products(w, k, mixture)
    work.b[slot] = mixture.right[k]
    for j in range(slot + 1):
        work.G[slot, j] = mixture.gram[k, active[j]]
        work.G[j, slot] = work.G[slot, j]


@kernel
def _best(tolerance: float, m: int, active: Indices, a: Array, work: Work, mixture: Mixture) -> int:
    """Return the material that gains most beside the active ones, or -1."""
    best, gain = -1, tolerance
    for k in range(mixture.norm2.shape[0]):
        g, used = mixture.right[k], False
        for j in range(m):
            g -= a[j] * mixture.gram[active[j], k]
            used = used or active[j] == k
        if used or not g > 0.0 or not mixture.norm2[k] > 1e-30:
            continue
        rest = mixture.norm2[k]
        for j in range(m):
            work.x[j] = mixture.gram[active[j], k]
        solve_lower(work.L, work.x, m)
        for j in range(m):
            rest -= work.x[j] * work.x[j]
        # Below 1e-5 a material is the active ones over again, to rounding.
        if rest > 1e-5 * mixture.norm2[k] and g * g > gain * rest:
            best, gain = k, g * g / rest
    return best


@kernel
def refit(w: Array, y: Array, m: int, active: Indices, a: Array, work: Work) -> int:
    """Weighted non-negative least squares on the active columns, which are in ``work.columns``; returns how many."""
    _active_products(w, y, m, work)
    return solve_active(m, active, a, work.columns, work.G, work.b, work.L, work.x)


@fast_kernel
def _active_products(w: Array, y: Array, m: int, work: Work) -> None:
    columns = work.columns
    for j in range(m):
        right = 0.0
        for row in range(w.shape[0]):
            right += w[row] * columns[j, row] * y[row]
        work.b[j] = right
        for i in range(j + 1):
            total = 0.0
            for row in range(w.shape[0]):
                total += w[row] * columns[j, row] * columns[i, row]
            work.G[j, i] = total
            work.G[i, j] = total
