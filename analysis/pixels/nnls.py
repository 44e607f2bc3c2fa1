"""Non-negative least squares for one small problem, in Gram form, with few active columns.

Scalar numba code without Python objects. `scipy.optimize.nnls` solves the same problem and is what the
tests compare with; it is a hundred times slower here, since it starts cold and keeps every column.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.kernel import fast_kernel, kernel

Array = NDArray[np.float64]

Array32 = NDArray[np.float32]

Indices = NDArray[np.int64]


class Work(NamedTuple):
    """Scratch of one problem of N rows and K atoms, and what is known of its solution."""

    columns: NDArray[np.float64]  # [MAX_ATOMS, N] the active atoms
    G: NDArray[np.float64]  # [MAX_ATOMS, MAX_ATOMS] their Gram matrix
    b: NDArray[np.float64]  # [MAX_ATOMS] their products with the target
    L: NDArray[np.float64]  # [MAX_ATOMS, MAX_ATOMS] the Cholesky factor of G
    x: NDArray[np.float64]  # [MAX_ATOMS]
    r: NDArray[np.float64]  # [N] the residual
    g: NDArray[np.float32]  # [K]
    d: NDArray[np.float32]  # [K]
    cross: NDArray[np.float64]  # [MAX_ATOMS, K]
    rest: NDArray[np.float64]  # [K]


MAX_ATOMS = 6
"""Most atoms that one channel of one pixel may use; more never paid (docs/decisions/0004)."""


@kernel
def cholesky(G: Array, m: int, L: Array) -> bool:
    """Factor the leading m by m block of G = L L^T; False if it is not positive definite."""
    for i in range(m):
        for j in range(i + 1):
            total = G[i, j]
            if i == j:
                # Near-copies of an atom make the block singular to rounding; this keeps the pivots.
                total *= 1.0 + 1e-10
            for k in range(j):
                total -= L[i, k] * L[j, k]
            if i == j:
                if not total > 1e-12 * G[i, i]:
                    return False
                L[i, i] = math.sqrt(total)
            else:
                L[i, j] = total / L[j, j]
    return True


@kernel
def solve_lower(L: Array, x: Array, m: int) -> None:
    """Solve L x = b in place of b."""
    for i in range(m):
        total = x[i]
        for k in range(i):
            total -= L[i, k] * x[k]
        x[i] = total / L[i, i]


@kernel
def solve_factored(L: Array, b: Array, m: int, x: Array) -> None:
    """Solve L L^T x = b."""
    for i in range(m):
        x[i] = b[i]
    solve_lower(L, x, m)
    for i in range(m - 1, -1, -1):
        total = x[i]
        for k in range(i + 1, m):
            total -= L[k, i] * x[k]
        x[i] = total / L[i, i]


@fast_kernel
def _gather(
    phi: Array32, w: Array, y: Array, k: int, slot: int, active: Indices, columns: Array, G: Array, b: Array
) -> None:
    """Put atom k into `slot`: its column, its row of the Gram matrix, its right-hand side."""
    n_views = phi.shape[0]
    active[slot] = k
    right = 0.0
    for v in range(n_views):
        columns[slot, v] = phi[v, k]
        right += w[v] * y[v] * columns[slot, v]
    b[slot] = right
    for j in range(slot + 1):
        total = 0.0
        for v in range(n_views):
            total += w[v] * columns[slot, v] * columns[j, v]
        G[slot, j] = total
        G[j, slot] = total


@kernel
def _drop(slot: int, m: int, active: Indices, a: Array, columns: Array, G: Array, b: Array) -> None:
    """Take the atom in `slot` out of the first m."""
    for j in range(slot, m - 1):
        active[j] = active[j + 1]
        a[j] = a[j + 1]
        b[j] = b[j + 1]
        for v in range(columns.shape[1]):
            columns[j, v] = columns[j + 1, v]
        for i in range(m):
            G[j, i] = G[j + 1, i]
    for j in range(slot, m - 1):
        for i in range(m - 1):
            G[i, j] = G[i, j + 1]


@kernel
def solve_active(m: int, active: Indices, a: Array, columns: Array, G: Array, b: Array, L: Array, x: Array) -> int:
    """Least squares on the active atoms, those that turn negative dropped [lawson1974, ch. 23]; returns m."""
    while m > 0:
        if not cholesky(G, m, L):
            _drop(m - 1, m, active, a, columns, G, b)
            m -= 1
            continue
        solve_factored(L, b, m, x)
        worst, step = -1, 1.0
        for j in range(m):
            if x[j] <= 0.0:
                t = a[j] / (a[j] - x[j]) if a[j] > 0.0 else 0.0
                if t < step:
                    step, worst = t, j
        if worst < 0:
            for j in range(m):
                a[j] = x[j]
            return m
        for j in range(m):
            a[j] = max(a[j] + step * (x[j] - a[j]), 0.0)
        _drop(worst, m, active, a, columns, G, b)
        m -= 1
    return 0


@fast_kernel
def _correlations(phi: Array32, w: Array, r: Array, g: Array32) -> None:
    """g_k = sum_v w r phi_k for all atoms."""
    n_views, n_atoms = phi.shape
    g[:] = 0.0
    # Four rows at a time, since loading and storing the sums takes longer than adding to them.
    whole = n_views - n_views % 4
    for v in range(0, whole, 4):
        c0, c1 = np.float32(w[v] * r[v]), np.float32(w[v + 1] * r[v + 1])
        c2, c3 = np.float32(w[v + 2] * r[v + 2]), np.float32(w[v + 3] * r[v + 3])
        for k in range(n_atoms):
            g[k] += c0 * phi[v, k] + c1 * phi[v + 1, k] + c2 * phi[v + 2, k] + c3 * phi[v + 3, k]
    for v in range(whole, n_views):
        c = np.float32(w[v] * r[v])
        for k in range(n_atoms):
            g[k] += c * phi[v, k]


@fast_kernel
def _squared_norms(phi: Array32, w: Array, d: Array32) -> None:
    """d_k = sum_v w phi_k^2 for all atoms."""
    n_views, n_atoms = phi.shape
    d[:] = 0.0
    for v in range(n_views):
        wv = np.float32(w[v])
        for k in range(n_atoms):
            p = phi[v, k]
            d[k] += wv * p * p


@kernel
def nnls(
    phi: Array32, w: Array, y: Array, tolerance: float, most: int, m: int, active: Indices, a: Array, work: Work
) -> int:
    """Weighted non-negative least squares with at most `most` atoms, each of which must pay.

    Minimises sum_v w_v (y_v - sum_k a_k phi_vk)^2 over a >= 0 by the active-set method in Gram form
    [lawson1974], adding the atom that lowers the sum most while that is more than `tolerance`.

    Parameters
    ----------
    phi : ndarray of float32, shape (n_views, n_atoms)
    w, y : ndarray, shape (n_views,)
    tolerance : float
        Smallest gain in the weighted sum of squares for which an atom is added.
    most : int
        At most `MAX_ATOMS`.
    m, active, a : int and ndarrays of shape (MAX_ATOMS,)
        A warm start, updated in place: the number of active atoms, their indices and coefficients.
    work : Work
        On return its columns, G, L and r are those of the solution.

    Returns
    -------
    int
        The number of active atoms.
    """
    columns, G, b, L, x, r, g, d, _, _ = work
    n_atoms = phi.shape[1]
    if m < most:
        _squared_norms(phi, w, d)
    for slot in range(m):
        _gather(phi, w, y, active[slot], slot, active, columns, G, b)
    m = solve_active(m, active, a, columns, G, b, L, x)
    for _ in range(3 * MAX_ATOMS):
        residual(columns, a, m, y, r)
        if m >= most:
            break
        _correlations(phi, w, r, g)
        best, gain = -1, tolerance
        for k in range(n_atoms):
            if g[k] > 0.0 and d[k] > 1e-30 and g[k] * g[k] > gain * d[k]:
                used = False
                for j in range(m):
                    used = used or active[j] == k
                if not used:
                    best, gain = k, g[k] * g[k] / d[k]
        if best < 0:
            best = _best_beside_active(phi, w, tolerance, m, active, work)
        if best < 0:
            break
        a[m] = 0.0
        _gather(phi, w, y, best, m, active, columns, G, b)
        m_new = solve_active(m + 1, active, a, columns, G, b, L, x)
        stuck = m_new == m and (m == 0 or active[m - 1] != best)
        kept = False
        for j in range(m_new):
            kept = kept or active[j] == best
        m = m_new
        if stuck and not kept:
            # The new atom was thrown out at once: it is a copy, to rounding, of what is there.
            residual(columns, a, m, y, r)
            break
    return m


@kernel
def _best_beside_active(phi: Array32, w: Array, tolerance: float, m: int, active: Indices, work: Work) -> int:
    """Return the atom that gains most once the active ones have made room for it, or -1.

    g^2 / d is the gain with the others held fixed, which between near-parallel atoms is next to nothing.
    With them free it is g^2 over the Schur complement d - |L^-1 b|^2, b the products with the active atoms.
    """
    g, d, rest = work.g, work.d, work.rest
    _schur_complements(phi, w, m, work)
    best, gain = -1, tolerance
    for k in range(phi.shape[1]):
        # An atom that gains nothing by itself, or that the active ones make to rounding, would enter on rounding.
        worth = g[k] > 0.0 and d[k] > 1e-30 and g[k] * g[k] > 1e-3 * tolerance * d[k] and rest[k] > 1e-5 * d[k]
        if worth and g[k] * g[k] > gain * rest[k]:
            used = False
            for j in range(m):
                used = used or active[j] == k
            if not used:
                best, gain = k, g[k] * g[k] / rest[k]
    return best


@fast_kernel
def _schur_complements(phi: Array32, w: Array, m: int, work: Work) -> None:
    """rest_k = d_k - |L^-1 b_k|^2 with b_jk = sum_v w column_j phi_k, for all atoms side by side."""
    n_views, n_atoms = phi.shape
    columns, L, cross, rest = work.columns, work.L, work.cross, work.rest
    for k in range(n_atoms):
        rest[k] = work.d[k]
    for j in range(m):
        for k in range(n_atoms):
            cross[j, k] = 0.0
        for v in range(n_views):
            c = w[v] * columns[j, v]
            for k in range(n_atoms):
                cross[j, k] += c * phi[v, k]
        for i in range(j):
            for k in range(n_atoms):
                cross[j, k] -= L[j, i] * cross[i, k]
        pivot = 1.0 / L[j, j]
        for k in range(n_atoms):
            cross[j, k] *= pivot
            rest[k] -= cross[j, k] * cross[j, k]


@fast_kernel
def residual(columns: Array, a: Array, m: int, y: Array, r: Array) -> None:
    """Write r = y - sum_j a_j column_j."""
    for v in range(y.shape[0]):
        r[v] = y[v]
    for j in range(m):
        for v in range(y.shape[0]):
            r[v] -= a[j] * columns[j, v]


@kernel
def nnls_work(n_views: int, n_atoms: int) -> Work:
    """Allocate the scratch of `nnls`."""
    return Work(
        np.zeros((MAX_ATOMS, n_views)),
        np.zeros((MAX_ATOMS, MAX_ATOMS)),
        np.zeros(MAX_ATOMS),
        np.zeros((MAX_ATOMS, MAX_ATOMS)),
        np.zeros(MAX_ATOMS),
        np.zeros(n_views),
        np.zeros(n_atoms, np.float32),
        np.zeros(n_atoms, np.float32),
        np.zeros((MAX_ATOMS, n_atoms)),
        np.zeros(n_atoms),
    )
