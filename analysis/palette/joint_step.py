"""One Gauss-Newton step on the curves of a palette, all pixels' own unknowns eliminated (Schur complement).

The model of view v and channel c at a pixel that mixes materials k with shares b_k is

    m_vc = s_v sum_k b_k F_kc(t_v) exp(sum_j l_kcj hat_j(t_v)) ,   t = sqrt(1 - n.h) ,

with hats hat_j over the knots of t. With A the derivatives to l (at l = 0), B those to the pixel's own
unknowns (two of the normal, the shares), W the weights and r the residuals, the step solves

    [sum_p A'WA - A'WB (B'WB)^-1 B'WA] dl = sum_p A'Wr - A'WB (B'WB)^-1 B'Wr ,

so that a curve moves knowing how normals and shares will follow. Changing curves and pixels in turn instead
stalls, since a curve's slope and the normals trade against each other (docs/decisions/0009).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.kernel import kernel
from analysis.pixels.model import Fit, allocate_fit, evaluate, normal_equations
from analysis.pixels.nnls import MAX_ATOMS, Work, cholesky, nnls_work, solve_lower
from analysis.pixels.samples import (
    OUTLIER,
    Geometry,
    Pixel,
    Samples,
    Settings,
    allocate_pixel,
    load,
    median_chi2,
    plain_weights,
    robust_weights,
)
from analysis.pixels.starts import tangents

Array = NDArray[np.float64]

Array32 = NDArray[np.float32]

N_KNOTS = 40

KNOTS = np.linspace(0.0, 1.0, N_KNOTS) ** 1.5
"""Knots in t, denser towards the highlight."""

_N_OWN = 2 + MAX_ATOMS


class Shares(NamedTuple):
    """What each of P pixels is made of, and how it lies."""

    normal: NDArray[np.float64]  # [P, 3]; NaN = not solved
    material: NDArray[np.int16]  # [P, MAX_ATOMS]; -1 = none
    share: NDArray[np.float64]  # [P, MAX_ATOMS]
    weight: NDArray[np.float64]  # [P] of the pixel's chi-square against the others'


class _System(NamedTuple):
    """The normal equations of one pixel: D of its own unknowns, E across to the curves, the rest of the curves."""

    D: NDArray[np.float64]  # [own, own]
    L: NDArray[np.float64]  # [own, own] its Cholesky factor
    E: NDArray[np.float64]  # [own, MAX_ATOMS * C * N_KNOTS], then L^-1 E
    rest: NDArray[np.float64]  # [own], then L^-1 rest
    touched: NDArray[np.int64]  # columns of E that are not zero
    place: NDArray[np.int64]  # and their places among all curves' unknowns


@kernel
def accumulate(
    samples: Samples,
    geometry: Geometry,
    settings: Settings,
    table: Array32,
    derivative: Array32,
    knots: Array,
    shares: Shares,
    first: int,
    last: int,
    S: Array,
    rhs: Array,
) -> None:
    """Add pixels `first` to `last` - 1 to the reduced system.

    Parameters
    ----------
    samples, geometry, settings
        As `pixel_solver.solve_pixels` takes them, ``settings.shared`` set.
    table, derivative : ndarray of float32, shape (C, n_nodes, K)
    knots : ndarray, shape (N_KNOTS,)
    shares : Shares
    first, last : int
    S, rhs : ndarray, shapes (Q, Q) and (Q,), Q = K * C * N_KNOTS
        Added to; only the upper triangle of S. Unknown (k, c, j) has the place (k * C + c) * N_KNOTS + j.
    """
    n_views, _, n_channels = samples.radiance.shape
    px, fit = allocate_pixel(n_views, n_channels), allocate_fit(n_views, n_channels, settings, table)
    work = nnls_work(fit.target.shape[1], table.shape[2])
    system = _allocate(n_channels)
    for p in range(first, last):
        if not math.isfinite(shares.normal[p, 0]):
            continue
        _linearise(samples, geometry, settings, table, derivative, shares, p, px, fit, work)
        n_touched = _fill(px, fit, knots, system, S, rhs)
        if not _eliminate(system, 2 + fit.n_active[0], n_touched):
            continue
        _reduce(system, 2 + fit.n_active[0], n_touched, S, rhs)


@kernel
def normal_variance_of_curves(
    samples: Samples,
    geometry: Geometry,
    settings: Settings,
    table: Array32,
    derivative: Array32,
    knots: Array,
    shares: Shares,
    covariance: Array,
    first: int,
    last: int,
    out: Array,
) -> None:
    """Write what the curves' own error adds to the variance of each normal: (B'WB)^-1 B'WA cov A'WB (B'WB)^-1.

    Parameters
    ----------
    samples, geometry, settings, table, derivative, knots, shares, first, last
        As `accumulate`.
    covariance : ndarray, shape (Q, Q)
        Of the curves' unknowns.
    out : ndarray, shape (P,)
        Mean over the two tangent axes, rad^2; NaN = not solved.
    """
    n_views, _, n_channels = samples.radiance.shape
    px, fit = allocate_pixel(n_views, n_channels), allocate_fit(n_views, n_channels, settings, table)
    work = nnls_work(fit.target.shape[1], table.shape[2])
    system = _allocate(n_channels)
    Q = covariance.shape[0]
    nothing, none = np.zeros((Q, Q)), np.zeros(Q)
    x, row = np.zeros(_N_OWN), np.zeros(len(system.touched))
    for p in range(first, last):
        out[p] = np.nan
        if not math.isfinite(shares.normal[p, 0]):
            continue
        _linearise(samples, geometry, settings, table, derivative, shares, p, px, fit, work)
        n_touched = _fill(px, fit, knots, system, nothing, none)
        n_own = 2 + fit.n_active[0]
        if not _eliminate(system, n_own, n_touched):
            continue
        out[p] = 0.0
        for e in range(2):
            # Row e of D^-1 E, which is (L^-1 e)' (L^-1 E).
            x[:] = 0.0
            x[e] = 1.0
            solve_lower(system.L, x, n_own)
            for i in range(n_touched):
                row[i] = 0.0
                for d in range(n_own):
                    row[i] += x[d] * system.E[d, system.touched[i]]
            for i in range(n_touched):
                for j in range(n_touched):
                    out[p] += 0.5 * row[i] * covariance[system.place[i], system.place[j]] * row[j]


@kernel
def _allocate(n_channels: int) -> _System:
    n = MAX_ATOMS * n_channels * N_KNOTS
    return _System(
        np.zeros((_N_OWN, _N_OWN)),
        np.zeros((_N_OWN, _N_OWN)),
        np.zeros((_N_OWN, n)),
        np.zeros(_N_OWN),
        np.zeros(n, np.int64),
        np.zeros(n, np.int64),
    )


@kernel
def _linearise(
    samples: Samples,
    geometry: Geometry,
    settings: Settings,
    table: Array32,
    derivative: Array32,
    shares: Shares,
    p: int,
    px: Pixel,
    fit: Fit,
    work: Work,
) -> None:
    """Leave columns, Jacobian, weights and residuals of pixel p in `fit`, at its normal and with its materials."""
    load(samples, geometry, settings, p, px)
    fit.n_active[0] = 0
    for j in range(MAX_ATOMS):
        if shares.material[p, j] >= 0:
            fit.active[0, fit.n_active[0]] = shares.material[p, j]
            fit.a[0, fit.n_active[0]] = shares.share[p, j]
            fit.n_active[0] += 1
    normal = shares.normal[p]
    plain_weights(px, settings)
    evaluate(px, fit, settings, table, work, normal, np.inf, 0.0)
    robust_weights(px, settings, OUTLIER * max(1.0, median_chi2(px)))
    evaluate(px, fit, settings, table, work, normal, np.inf, 0.0)
    t1, t2, H, gradient = np.empty(3), np.empty(3), np.empty((2, 2)), np.empty(2)
    tangents(normal, t1, t2)
    normal_equations(px, fit, settings, derivative, t1, t2, H, gradient)
    fit.pull[0] *= shares.weight[p]


@kernel
def _fill(px: Pixel, fit: Fit, knots: Array, system: _System, S: Array, rhs: Array) -> int:
    """Fill the pixel's system and add A'WA and A'Wr to the curves'; returns how many columns of E are touched."""
    n_channels, n_views = px.y.shape
    m = fit.n_active[0]
    n_own = 2 + m
    n_knots = knots.shape[0]
    D, E, rest = system.D, system.E, system.rest
    D[:] = 0.0
    E[:] = 0.0
    rest[:] = 0.0
    for e in range(2):
        D[e, e] = px.prior[3]
    own = np.empty(n_own)
    for ch in range(n_channels):
        for v in range(n_views):
            row = ch * (n_views + 1) + v
            w = fit.pull[0, row]
            if not w > 0.0:
                continue
            own[0], own[1] = fit.J[0, row], fit.J[1, row]
            for a in range(m):
                own[2 + a] = fit.columns[0, a, row]
            r = fit.r[0, row]
            for d in range(n_own):
                rest[d] += w * own[d] * r
                for e in range(d + 1):
                    D[d, e] += w * own[d] * own[e]
            t = math.sqrt(1.0 - px.cosine_h[v])
            j = min(int(np.searchsorted(knots, t, "right")) - 1, n_knots - 2)
            f = (t - knots[j]) / (knots[j + 1] - knots[j])
            for a in range(m):
                part = fit.a[0, a] * fit.columns[0, a, row]
                for side in range(2):
                    A = part * (f if side == 1 else 1.0 - f)
                    column = (a * n_channels + ch) * n_knots + j + side
                    q = (fit.active[0, a] * n_channels + ch) * n_knots + j + side
                    rhs[q] += w * A * r
                    for d in range(n_own):
                        E[d, column] += w * own[d] * A
                    for b in range(m):
                        other = fit.a[0, b] * fit.columns[0, b, row]
                        for side_b in range(2):
                            q_b = (fit.active[0, b] * n_channels + ch) * n_knots + j + side_b
                            if q_b >= q:
                                S[q, q_b] += w * A * other * (f if side_b == 1 else 1.0 - f)
    n_touched = 0
    for a in range(m):
        for ch in range(n_channels):
            for j in range(n_knots):
                column = (a * n_channels + ch) * n_knots + j
                if E[2 + a, column] != 0.0:
                    system.touched[n_touched] = column
                    system.place[n_touched] = (fit.active[0, a] * n_channels + ch) * n_knots + j
                    n_touched += 1
    return n_touched


@kernel
def _eliminate(system: _System, n_own: int, n_touched: int) -> bool:
    """Factor D = L L', then L^-1 E and L^-1 rest in place; False if D is singular."""
    if not cholesky(system.D, n_own, system.L):
        return False
    solve_lower(system.L, system.rest, n_own)
    x = np.empty(n_own)
    for i in range(n_touched):
        column = system.touched[i]
        for d in range(n_own):
            x[d] = system.E[d, column]
        solve_lower(system.L, x, n_own)
        for d in range(n_own):
            system.E[d, column] = x[d]
    return True


@kernel
def _reduce(system: _System, n_own: int, n_touched: int, S: Array, rhs: Array) -> None:
    """Take (L^-1 E)'(L^-1 E) and (L^-1 E)' L^-1 rest off the curves' system."""
    for i in range(n_touched):
        q, column = system.place[i], system.touched[i]
        for d in range(n_own):
            x = system.E[d, column]
            rhs[q] -= x * system.rest[d]
            for j in range(n_touched):
                if system.place[j] >= q:
                    S[q, system.place[j]] -= x * system.E[d, system.touched[j]]
