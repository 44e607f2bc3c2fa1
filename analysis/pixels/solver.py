"""Normal and BRDF curve of one pixel at a time: Levenberg-Marquardt around `analysis.pixels.model`.

Several starts, robust weights renewed until the typical residual stays, and what is then known of the
pixel. Scalar numba code without Python objects. A pixel depends on nothing but its own samples, so any
tiling and any number of threads give the same bits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.kernel import kernel
from analysis.pixels.model import PRICED_STEP, Fit, allocate_fit, evaluate, marginal_information, normal_equations
from analysis.pixels.nnls import MAX_ATOMS, Indices, Work, nnls_work
from analysis.pixels.samples import (
    BLACK,
    NOT_CONVERGED,
    OUTLIER,
    POOR_FIT,
    TOO_FEW_VIEWS,
    Geometry,
    Pixel,
    Samples,
    Settings,
    allocate_pixel,
    judge_views,
    load,
    median_chi2,
    plain_weights,
    robust_cost,
    robust_weights,
    usable,
)
from analysis.pixels.starts import N_LIKELY, N_STARTS, assign, normalise, start, tangents

Array = NDArray[np.float64]

Array32 = NDArray[np.float32]

_START_STEPS, _STEPS = 4, 10

_START_ROUNDS, _ROUNDS = 3, 8

_ENOUGH = 2.0  # scale of the residuals at which a start has shown what it is worth

_SETTLED_SCALE = 0.9  # of the scale of the round before, above which another round would change little

_FEW_VIEWS = 15

# Where so many views are taken for wrong it is the normal that is: steep ones, and such whose highlight is clipped,
# are missed by all likely starts. A pixel that fits none of the palette's materials is another matter.
_MANY_WRONG = 0.2

_GOOD_FIT = 1.5  # cost a view below which a start has found its minimum and the others are not tried

_GOOD_SHARED_FIT = 1.2  # the same with a palette, which leaves less to the dictionary's error

_SETTLED = 1e-3  # fall of the cost below which the step was the last: it moved the normal by 3 % of its sigma

_MAX_STEP = 0.25  # rad; beyond it the slope of a curve means nothing

_CONVERGED_STEP = 1e-5  # rad, about 0.0006 deg

_POOR_FIT = 25.0  # chi-square per degree of freedom: residuals of five times the stated noise

# A misfit that is seen stands for one that is not: a wrong curve's slope turns the normal more than it shows in the
# residuals. Chosen by the coverage over views and noise (decision 4).
_MISFIT_SEEN = 1.05

_CUBED_TO = 2.0  # a fit that is worse than that is no curve's fault alone; its residuals say how bad it is


class Solution(NamedTuple):
    """What was found, filled in place."""

    normal: NDArray[np.float64]  # [P, 3]; NaN = not solved
    covariance: NDArray[np.float64]  # [P, 3]: xx, xy, yy of the tangent parameters, rad^2
    reduced_chi2: NDArray[np.float64]  # [P] without the views taken for wrong
    loss: NDArray[np.float64]  # [P] Cauchy's loss a view, what robust weights minimise
    atom: NDArray[np.int16]  # [P, G, MAX_ATOMS] of G groups of rows (channels, or one for all); -1 = none
    coefficient: NDArray[np.float64]  # [P, G, MAX_ATOMS], of the scaled atoms
    flags: NDArray[np.uint8]  # [P]
    n_dot_h_range: NDArray[np.float64]  # [P, 2]: smallest and largest n.h seen


@kernel
def solve_pixels(
    samples: Samples,
    geometry: Geometry,
    settings: Settings,
    table: Array32,
    derivative: Array32,
    first: int,
    last: int,
    out: Solution,
) -> None:
    """Solve pixels `first` to `last` - 1 (see the module's docstring), writing into `out`.

    Parameters
    ----------
    samples : Samples
    geometry : Geometry
    settings : Settings
    table, derivative : ndarray of float32, shape (n_layers, n_nodes, n_atoms)
        `analysis.reflectance.dictionary.SliceTable`; one layer for all channels, or with ``settings.shared`` one for
        each.
    first, last : int
    out : Solution
    """
    n_views, _, n_channels = samples.radiance.shape
    px = allocate_pixel(n_views, n_channels)
    fit = allocate_fit(n_views, n_channels, settings, table)
    work = nnls_work(fit.target.shape[1], table.shape[2])
    normal = np.empty(3)
    best = np.empty(3)
    H = np.empty((2, 2))
    limits = np.array([_ROUNDS, _STEPS])
    for p in range(first, last):
        load(samples, geometry, settings, p, px)
        flags = usable(px)
        if flags & (TOO_FEW_VIEWS | BLACK):
            _write_unsolved(p, flags, out)
            continue
        best_cost, best_wrong, at_best, converged = np.inf, 1.0, False, False
        # A normal that was found before is gone on from; the cold starts are for when there is none.
        warm = math.isfinite(geometry.start[p, 0])
        # Where few samples leave several normals open, a near-planar sample's is the one that flat leads to;
        # where many decide, a Lambertian fit is nearer to it.
        first_start = 0 if n_views < _FEW_VIEWS else 1
        for kind in range(-1 if warm else 0, N_STARTS if settings.cold or not warm else 0):
            if kind >= N_LIKELY and (settings.shared or best_wrong < _MANY_WRONG):
                break
            if kind < 0:
                assign(normal, geometry.start[p])
            elif not start((kind + first_start) % N_LIKELY if kind < N_LIKELY else kind, px, normal):
                continue
            plain_weights(px, settings)
            _begin(px, fit, settings, table, work, normal)
            rounds, steps, enough = (_ROUNDS, _STEPS, 1.0) if kind < 0 else (_START_ROUNDS, _START_STEPS, _ENOUGH)
            converged = _settle(px, fit, settings, table, derivative, work, normal, H, rounds, steps, enough)
            cost = robust_cost(px, settings, normal, OUTLIER)
            at_best = cost < best_cost
            n_telling, n_wrong = judge_views(px)
            if at_best:
                best_cost, best_wrong = cost, n_wrong / max(n_telling, 1)
                assign(best, normal)
            if cost < (_GOOD_SHARED_FIT if settings.shared else _GOOD_FIT) * n_telling:
                break
        if not (settings.shared and at_best and converged):
            assign(normal, best)
            if not at_best:
                plain_weights(px, settings)
            _begin(px, fit, settings, table, work, normal)
            # Read from an array, since literals would compile it all once more.
            rounds, steps = limits[0], limits[1]
            converged = _settle(px, fit, settings, table, derivative, work, normal, H, rounds, steps, 1.0)
        if not converged:
            flags |= NOT_CONVERGED
        if not settings.shared:
            marginal_information(px, fit, settings, derivative, H)
        _write(p, flags, px, fit, settings, normal, H, out)


@kernel
def _begin(px: Pixel, fit: Fit, settings: Settings, table: Array32, work: Work, normal: Array) -> None:
    """Fit at `normal` from nothing: atoms that were right on the way here would keep better ones out."""
    fit.n_active[:] = 0
    evaluate(px, fit, settings, table, work, normal, np.inf, np.inf)


@kernel
def _settle(
    px: Pixel,
    fit: Fit,
    settings: Settings,
    table: Array32,
    derivative: Array32,
    work: Work,
    normal: Array,
    H: Array,
    n_rounds: int,
    n_steps: int,
    enough: float,
) -> bool:
    """Weigh the views by how they fit, refine, and again until the typical residual stays; True if it converged.

    The scale of the weights is the median over the views, so that it tightens as wrong views lose their pull.
    A scale below `enough` will do.
    """
    scale, converged = max(1.0, median_chi2(px)), False
    for _ in range(n_rounds):
        robust_weights(px, settings, OUTLIER * scale)
        converged = _refine(px, fit, settings, table, derivative, work, normal, H, OUTLIER * scale, n_steps)
        before, scale = scale, max(1.0, median_chi2(px))
        if scale > _SETTLED_SCALE * before or scale < enough:
            break
    return converged


@kernel
def _copy_atoms(n: Indices, active: Indices, a: Array, n_to: Indices, active_to: Indices, a_to: Array) -> None:
    for group in range(n.shape[0]):
        n_to[group] = n[group]
        for j in range(MAX_ATOMS):
            active_to[group, j] = active[group, j]
            a_to[group, j] = a[group, j]


@kernel
def _refine(
    px: Pixel,
    fit: Fit,
    settings: Settings,
    table: Array32,
    derivative: Array32,
    work: Work,
    normal: Array,
    H: Array,
    kappa: float,
    n_steps: int,
) -> bool:
    """Levenberg-Marquardt on the tangent parameters, its curvature left in `H`; True if it converged."""
    t1, t2, gradient, trial = np.empty(3), np.empty(3), np.empty(2), np.empty(3)
    saved_n, saved_active, saved_a = np.zeros_like(fit.n_active), np.zeros_like(fit.active), np.zeros_like(fit.a)
    cost = evaluate(px, fit, settings, table, work, normal, kappa, 0.0)
    damping = 1e-3
    converged, priced = False, False
    for _ in range(n_steps):
        tangents(normal, t1, t2)
        normal_equations(px, fit, settings, derivative, t1, t2, H, gradient)
        _copy_atoms(fit.n_active, fit.active, fit.a, saved_n, saved_active, saved_a)
        accepted, shortest = False, False
        for _ in range(4):
            h00, h11 = H[0, 0] * (1.0 + damping), H[1, 1] * (1.0 + damping)
            determinant = h00 * h11 - H[0, 1] ** 2
            if not determinant > 0.0:
                damping = max(10.0 * damping, 1e-3)
                continue
            d1 = (h11 * gradient[0] - H[0, 1] * gradient[1]) / determinant
            d2 = (h00 * gradient[1] - H[0, 1] * gradient[0]) / determinant
            length = math.sqrt(d1 * d1 + d2 * d2)
            if length > _MAX_STEP:
                d1, d2 = d1 * _MAX_STEP / length, d2 * _MAX_STEP / length
            shortest = length < _CONVERGED_STEP
            for i in range(3):
                trial[i] = normal[i] + d1 * t1[i] + d2 * t2[i]
            if normalise(trial):
                new = evaluate(px, fit, settings, table, work, trial, kappa, length)
                if new < cost:
                    accepted, priced = True, length > PRICED_STEP
                    shortest = shortest or cost - new < _SETTLED
                    cost = new
                    assign(normal, trial)
                    damping = max(0.2 * damping, 1e-7)
                    break
            _copy_atoms(saved_n, saved_active, saved_a, fit.n_active, fit.active, fit.a)
            damping *= 8.0
            if shortest:
                break
        if shortest or not accepted:
            # The atoms in use may not be the ones to use here.
            new = cost
            if not (priced and accepted):
                new = evaluate(px, fit, settings, table, work, normal, kappa, 0.0 if priced else np.inf)
            settled = priced or cost - new < _SETTLED
            cost, priced = new, True
            if settled:
                converged = True
                break
    tangents(normal, t1, t2)
    normal_equations(px, fit, settings, derivative, t1, t2, H, gradient)
    return converged


@kernel
def _write_unsolved(p: int, flags: int, out: Solution) -> None:
    out.normal[p] = np.nan
    out.covariance[p] = np.nan
    out.reduced_chi2[p] = np.nan
    out.loss[p] = np.nan
    out.atom[p] = -1
    out.coefficient[p] = 0.0
    out.flags[p] = flags
    out.n_dot_h_range[p] = np.nan


@kernel
def _write(p: int, flags: int, px: Pixel, fit: Fit, settings: Settings, normal: Array, H: Array, out: Solution) -> None:
    """Write normal, covariance H^-1 (widened where the fit is worse than the noise) and coefficients."""
    n_channels, n_views = px.y.shape
    total, n_samples, n_unknowns, n_seen = 0.0, 0, 2, 0
    low, high = 1.0, 0.0
    for v in range(n_views):
        seen = False
        for ch in range(n_channels):
            kept = px.clipped[ch, v] and px.model[ch, v] > px.y[ch, v]
            if not px.weight[ch, v] > 0.0 or kept:
                continue
            seen = True
            # A view whose weight was halved is taken for wrong: two of forty do not make a good fit a poor one.
            if px.weight[ch, v] * px.sigma2[ch, v] > 0.5:
                r = px.y[ch, v] - px.model[ch, v]
                total += r * r * px.weight[ch, v]
                n_samples += 1
        n_seen += seen
        if seen and px.cosine_i[v] > 0.0:
            low = min(low, px.cosine_h[v])
            high = max(high, px.cosine_h[v])
    for group in range(fit.a.shape[0]):
        n_unknowns += fit.n_active[group]
        for j in range(MAX_ATOMS):
            used = j < fit.n_active[group]
            out.atom[p, group, j] = fit.active[group, j] if used else -1
            out.coefficient[p, group, j] = fit.a[group, j] if used else 0.0
    dof = max(n_samples - n_unknowns, 1)
    determinant = H[0, 0] * H[1, 1] - H[0, 1] ** 2
    out.reduced_chi2[p] = total / dof
    out.loss[p] = robust_cost(px, settings, normal, OUTLIER) / max(n_seen, 1)
    if total / dof > _POOR_FIT:
        flags |= POOR_FIT
    if not determinant > 0.0:
        # No direction of the tangent plane changes the fit: the normal is a guess, and says so.
        _write_unsolved(p, flags | BLACK, out)
        return
    misfit = max(1.0, _MISFIT_SEEN * total / dof)
    widening = min(misfit**3, _CUBED_TO**2 * misfit) / determinant
    out.covariance[p, 0] = H[1, 1] * widening
    out.covariance[p, 1] = -H[0, 1] * widening
    out.covariance[p, 2] = H[0, 0] * widening
    assign(out.normal[p], normal)
    out.flags[p] = flags
    out.n_dot_h_range[p, 0] = low
    out.n_dot_h_range[p, 1] = high
