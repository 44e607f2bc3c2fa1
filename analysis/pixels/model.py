"""A pixel's model at one normal: coefficients by non-negative least squares, and how the normal moves it.

With c_v = n.h_v and s_v = max(0, n.omega_i,v), the model of view v and channel ch is

    m_v,ch = sum_k a_ch,k phi_k(c_v) s_v ,   a >= 0 ,

where phi_k are dictionary atoms on the slice theta_d = 0 and radiances have been freed of light power
and inverse-square fall-off. The Jacobian to the two tangent parameters of n is projected off the active
atoms (variable projection [kaufman1975]), so that a step in n already accounts for the a that follow it.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.kernel import fast_kernel, kernel
from analysis.pixels.mixture import Mixture, allocate_mixture, choose, fill_column, refit
from analysis.pixels.nnls import MAX_ATOMS, Work, cholesky, nnls, residual, solve_factored
from analysis.pixels.samples import Pixel, Settings, robust_cost

Array = NDArray[np.float64]

Array32 = NDArray[np.float32]

# Atoms narrower than the smallest half angle seen, or dark up to the largest, would grow without bound: the curve's
# sum at theta_h = 0 and at 75 deg is held to this many times the brightest sample, one sigma. What was seen hardly
# feels it.
_PEAK = 3.0

_GRAZING_T = math.sqrt(1.0 - math.cos(math.radians(75.0)))

PRICED_STEP = 0.01
"""Step of the normal, rad, up to which the atoms in use stay the ones to use."""

# How freely the curve may have been another one than the atoms in use make: so many hats over t, denser towards the
# highlight, each within so much of the model for every atom in use. A curve that one atom makes is known better than
# one that takes six. Chosen by the coverage over views and noise (decision 4).
_N_HATS = 20

_CURVE_SIGMA = 0.02


class Fit(NamedTuple):
    """Scratch of the fit of one pixel: G groups of rows, each with coefficients of its own.

    A channel is a group of N + 1 rows, and all read one table of K atoms. With a palette all channels are one group,
    each with its own part of the rows and of the table.
    """

    phi: NDArray[np.float32]  # [N + 1, K]; the last row is the peak at theta_h = 0 with the grazing end
    mixture: Mixture  # with a palette, instead of phi
    node: NDArray[np.int64]  # [N] of the tables, below t = sqrt(1 - n.h)
    beyond: NDArray[np.float64]  # [N] fraction of a node
    tangent_h: NDArray[np.float64]  # [2, N] d n.h / d tangent
    tangent_i: NDArray[np.float64]  # [2, N] d n.omega_i / d tangent, 0 where the surface faces away
    target: NDArray[np.float64]  # [G, R] y of each group's R rows, 0 for the peak
    pull: NDArray[np.float64]  # [G, R] their weights, the prior's for the peak
    J: NDArray[np.float64]  # [2, R]
    n_active: NDArray[np.int64]  # [G]
    active: NDArray[np.int64]  # [G, MAX_ATOMS]
    a: NDArray[np.float64]  # [G, MAX_ATOMS]
    columns: NDArray[np.float64]  # [G, MAX_ATOMS, R]; this and the next two are `nnls.Work` of each group
    L: NDArray[np.float64]  # [G, MAX_ATOMS, MAX_ATOMS]
    r: NDArray[np.float64]  # [G, R]


@kernel
def allocate_fit(n_views: int, n_channels: int, settings: Settings, table: Array32) -> Fit:
    """Allocate the scratch of one pixel's fit to the atoms of `table`."""
    n_atoms = table.shape[2]
    n_groups, n_parts = (1, n_channels) if settings.shared else (n_channels, 1)
    n_rows = n_parts * (n_views + 1)
    fit = Fit(
        np.zeros((0 if settings.shared else n_views + 1, n_atoms), np.float32),
        allocate_mixture(n_atoms if settings.shared else 0, n_rows),
        np.zeros(n_views, np.int64),
        np.zeros(n_views),
        np.zeros((2, n_views)),
        np.zeros((2, n_views)),
        np.zeros((n_groups, n_rows)),
        np.zeros((n_groups, n_rows)),
        np.zeros((2, n_rows)),
        np.zeros(n_groups, np.int64),
        np.zeros((n_groups, MAX_ATOMS), np.int64),
        np.zeros((n_groups, MAX_ATOMS)),
        np.zeros((n_groups, MAX_ATOMS, n_rows)),
        np.zeros((n_groups, MAX_ATOMS, MAX_ATOMS)),
        np.zeros((n_groups, n_rows)),
    )
    if not settings.shared:
        for k in range(n_atoms):
            # Coefficients are positive, so that this sum holds down both ends of a curve.
            fit.phi[n_views, k] = table[0, 0, k] + table[0, int(_GRAZING_T * (table.shape[1] - 1)), k]
    return fit


@kernel
def _turn(n: Array, px: Pixel, fit: Fit, n_nodes: int) -> None:
    """Cosines at the normal `n`, and where in the tables they lie."""
    for v in range(px.half.shape[1]):
        c = n[0] * px.half[0, v] + n[1] * px.half[1, v] + n[2] * px.half[2, v]
        s = n[0] * px.light[0, v] + n[1] * px.light[1, v] + n[2] * px.light[2, v]
        c = min(max(c, 0.0), 1.0)
        px.cosine_h[v] = c
        px.cosine_i[v] = max(s, 0.0)
        x = math.sqrt(1.0 - c) * (n_nodes - 1)
        fit.node[v] = min(int(x), n_nodes - 2)
        fit.beyond[v] = x - fit.node[v]


@fast_kernel
def _fill_atoms(px: Pixel, fit: Fit, table: Array32) -> None:
    """phi[v, k] = phi_k(c_v) s_v of every atom; zero where the surface faces away."""
    n_rows, n_atoms = fit.phi.shape
    for v in range(n_rows - 1):
        i = fit.node[v]
        low = np.float32(px.cosine_i[v] * (1.0 - fit.beyond[v]))
        high = np.float32(px.cosine_i[v] * fit.beyond[v])
        for k in range(n_atoms):
            fit.phi[v, k] = low * table[0, i, k] + high * table[0, i + 1, k]


@fast_kernel
def _fill_active_atoms(px: Pixel, fit: Fit, table: Array32, group: int) -> None:
    """Fill the columns of `phi` that one group uses."""
    for j in range(fit.n_active[group]):
        k = fit.active[group, j]
        for v in range(fit.phi.shape[0] - 1):
            i = fit.node[v]
            low = np.float32(px.cosine_i[v] * (1.0 - fit.beyond[v]))
            high = np.float32(px.cosine_i[v] * fit.beyond[v])
            fit.phi[v, k] = low * table[0, i, k] + high * table[0, i + 1, k]


@fast_kernel
def _load_target(px: Pixel, fit: Fit, settings: Settings, group: int, ch: int, row: int) -> int:
    """Put a channel's values and weights into a group's rows from `row` on; returns how many count."""
    n_views = px.y.shape[1]
    target, pull = fit.target[group], fit.pull[group]
    brightest, n_values = 0.0, 0
    for v in range(n_views):
        target[row + v] = px.y[ch, v]
        # A bound that the last model kept says nothing; one that it missed pulls like a value.
        kept = px.clipped[ch, v] and px.model[ch, v] > px.y[ch, v]
        w = 0.0 if kept else px.weight[ch, v]
        pull[row + v] = w
        brightest = max(brightest, px.y[ch, v] if w > 0.0 else 0.0)
        n_values += w > 0.0
    # A material's curve was found from many pixels; its peak is not this one's to hold down.
    free = settings.shared or brightest <= 0.0
    target[row + n_views] = 0.0
    pull[row + n_views] = 0.0 if free else 1.0 / (_PEAK * brightest) ** 2
    return n_values


@kernel
def _fit_group(px: Pixel, fit: Fit, settings: Settings, table: Array32, work: Work, group: int, grow: bool) -> None:
    """Fit the coefficients of one group of rows to the atoms in use, from the last ones; to new atoms too if `grow`."""
    n_views = px.y.shape[1]
    y, w, active, a = fit.target[group], fit.pull[group], fit.active[group], fit.a[group]
    n_values = 0
    for part in range(y.shape[0] // (n_views + 1)):
        n_values += _load_target(px, fit, settings, group, part if settings.shared else group, part * (n_views + 1))
    # With few views a curve of many atoms would pass through every sample, whatever the normal.
    most = min(max((n_values - 2) // 2, 1), settings.most) if grow else fit.n_active[group]
    m = min(fit.n_active[group], most)
    own = Work(
        fit.columns[group], work.G, work.b, fit.L[group], work.x, fit.r[group], work.g, work.d, work.cross, work.rest
    )
    if not settings.shared:
        if not grow:
            _fill_active_atoms(px, fit, table, group)
        m = nnls(fit.phi, w, y, settings.tolerance, most, m, active, a, own)
    elif grow:
        for k in range(table.shape[2]):
            fill_column(table, k, fit.node, fit.beyond, px.cosine_i, fit.mixture.column[k])
        m = choose(w, y, settings.tolerance, most, active, a, own, fit.mixture)
        residual(own.columns, a, m, y, own.r)
    else:
        for j in range(m):
            fill_column(table, active[j], fit.node, fit.beyond, px.cosine_i, own.columns[j])
        m = refit(w, y, m, active, a, own)
        residual(own.columns, a, m, y, own.r)
    fit.n_active[group] = m
    for part in range(y.shape[0] // (n_views + 1)):
        model, row = px.model[part if settings.shared else group], part * (n_views + 1)
        for v in range(n_views):
            model[v] = y[row + v] - own.r[row + v]


@kernel
def evaluate(
    px: Pixel, fit: Fit, settings: Settings, table: Array32, work: Work, normal: Array, kappa: float, moved: float
) -> float:
    """Cost at `normal`, coefficients refitted: to the atoms in use, or to all if the normal `moved` far (rad)."""
    grow = moved > PRICED_STEP
    _turn(normal, px, fit, table.shape[1])
    if grow and not settings.shared:
        _fill_atoms(px, fit, table)
    for group in range(fit.a.shape[0]):
        _fit_group(px, fit, settings, table, work, group, grow)
    return robust_cost(px, settings, normal, kappa)


@kernel
def normal_equations(
    px: Pixel,
    fit: Fit,
    settings: Settings,
    derivative: Array32,
    t1: Array,
    t2: Array,
    H: Array,
    gradient: Array,
) -> None:
    """Write H = J^T W J and gradient J^T W r of the tangent parameters at the normal of the last evaluation."""
    H[:] = 0.0
    for e in range(2):
        t = t1 if e == 0 else t2
        H[e, e] = px.prior[3]
        gradient[e] = px.prior[3] * (t[0] * px.prior[0] + t[1] * px.prior[1] + t[2] * px.prior[2])
        h, w = px.half, px.light
        for v in range(h.shape[1]):
            lit = 1.0 if px.cosine_i[v] > 0.0 else 0.0
            fit.tangent_h[e, v] = t[0] * h[0, v] + t[1] * h[1, v] + t[2] * h[2, v]
            fit.tangent_i[e, v] = lit * (t[0] * w[0, v] + t[1] * w[1, v] + t[2] * w[2, v])
    for group in range(fit.a.shape[0]):
        _fill_jacobian(px, fit, settings, derivative, group)
        _project(fit, group, H, gradient)


@fast_kernel
def _fill_jacobian(px: Pixel, fit: Fit, settings: Settings, derivative: Array32, group: int) -> None:
    """J[e, row] = d m / d tangent e with the coefficients held: sum_k a_k (phi_k' s dc + phi_k ds)."""
    n_views = px.y.shape[1]
    slope = np.empty(n_views)
    for part in range(fit.target.shape[1] // (n_views + 1)):
        ch = part if settings.shared else group
        slope[:] = 0.0
        for j in range(fit.n_active[group]):
            k, a = fit.active[group, j], fit.a[group, j]
            for v in range(n_views):
                low, high = derivative[part, fit.node[v], k], derivative[part, fit.node[v] + 1, k]
                slope[v] += a * (low + fit.beyond[v] * (high - low))
        row = part * (n_views + 1)
        for v in range(n_views):
            s = px.cosine_i[v]
            value = px.model[ch, v] / s if s > 0.0 else 0.0
            for e in range(2):
                fit.J[e, row + v] = slope[v] * s * fit.tangent_h[e, v] + value * fit.tangent_i[e, v]


@fast_kernel
def _project(fit: Fit, group: int, H: Array, gradient: Array) -> None:
    """Add the group's J^T W J - B^T (A^T W A)^-1 B and J^T W r; A the active columns, B = A^T W J [kaufman1975]."""
    m, w, r, J, columns = fit.n_active[group], fit.pull[group], fit.r[group], fit.J, fit.columns[group]
    n_rows = w.shape[0]
    B, X = np.empty((2, MAX_ATOMS)), np.empty((2, MAX_ATOMS))
    for e in range(2):
        for j in range(m):
            total = 0.0
            for row in range(n_rows):
                total += w[row] * columns[j, row] * J[e, row]
            B[e, j] = total
        solve_factored(fit.L[group], B[e], m, X[e])
        total = 0.0
        for row in range(n_rows):
            total += w[row] * J[e, row] * r[row]
        gradient[e] += total
    for e in range(2):
        for d in range(e + 1):
            total = 0.0
            for row in range(n_rows):
                total += w[row] * J[e, row] * J[d, row]
            for j in range(m):
                total -= B[e, j] * X[d, j]
            H[e, d] += total
            if d != e:
                H[d, e] += total


@kernel
def marginal_information(px: Pixel, fit: Fit, settings: Settings, derivative: Array32, H: Array) -> None:
    """Write the information of the tangent parameters with the curve itself uncertain, after `normal_equations`.

    The atoms in use were chosen from the samples; that others might have been is not in their projection.
    It is made good by hats over t times the model, each with a prior of `_CURVE_SIGMA` for every atom in use:
    all but the tangent parameters are eliminated from the joint normal equations. A row touches two hats, so
    their own block is tridiagonal and goes first.
    """
    n = MAX_ATOMS + 2
    T, U, M, L = np.zeros((2, _N_HATS)), np.zeros((n, _N_HATS)), np.zeros((n, n)), np.zeros((n, n))
    H[:] = 0.0
    for e in range(2):
        H[e, e] = px.prior[3]
    for group in range(fit.a.shape[0]):
        m = fit.n_active[group]
        _fill_jacobian(px, fit, settings, derivative, group)
        _joint_equations(px, fit, group, derivative.shape[1], T, U, M)
        for i in range(_N_HATS):
            T[0, i] += 1.0 / (_CURVE_SIGMA * max(m, 1)) ** 2
        _eliminate_hats(T, U, M, m + 2)
        if not cholesky(M, m + 2, L):
            continue
        # What is left of the tangents' block once the atoms are eliminated is the product of its own factor.
        for e in range(2):
            for d in range(2):
                for k in range(m, m + 2):
                    H[e, d] += L[m + e, k] * L[m + d, k]


@fast_kernel
def _joint_equations(px: Pixel, fit: Fit, group: int, n_nodes: int, T: Array, U: Array, M: Array) -> None:
    """Fill the normal equations of a group: hats T (diagonal, next to it), atoms and tangents M, across U."""
    m, w, J, columns = fit.n_active[group], fit.pull[group], fit.J, fit.columns[group]
    T[:] = 0.0
    U[:] = 0.0
    for a in range(m + 2):
        A = columns[a] if a < m else J[a - m]
        for b in range(a + 1):
            B = columns[b] if b < m else J[b - m]
            total = 0.0
            for row in range(w.shape[0]):
                total += w[row] * A[row] * B[row]
            M[a, b] = total
    for v in range(w.shape[0] - 1):
        t = (fit.node[v] + fit.beyond[v]) / (n_nodes - 1)
        u = t ** (2.0 / 3.0) * (_N_HATS - 1)
        i = min(int(u), _N_HATS - 2)
        high = (u - i) * px.model[group, v]
        low = px.model[group, v] - high
        T[0, i] += w[v] * low * low
        T[1, i] += w[v] * low * high
        T[0, i + 1] += w[v] * high * high
        for a in range(m + 2):
            A = columns[a, v] if a < m else J[a - m, v]
            U[a, i] += w[v] * low * A
            U[a, i + 1] += w[v] * high * A


@kernel
def _eliminate_hats(T: Array, U: Array, M: Array, n: int) -> None:
    """Take U T^-1 U' off the lower triangle of the leading n by n block of M; T and U are used up."""
    for i in range(_N_HATS):
        if i > 0:
            below = T[1, i - 1] / T[0, i - 1]
            T[0, i] -= below * T[1, i - 1]
            for a in range(n):
                U[a, i] -= below * U[a, i - 1]
        for a in range(n):
            for b in range(a + 1):
                M[a, b] -= U[a, i] * U[b, i] / T[0, i]
