"""Fits the portable surface model to BRDFs: metal or dielectric, and a clear coat where the curve needs two lobes.

Given its roughness a surface is linear in (1 - F0) colour and F0, so that every roughness of a grid is tried by a few
moments of the curves. What minimises sum w (model - f)^2 / (f + 0.1 mean f)^2 looks alike in bright and in dark places:
plain least squares is 2 to 7 dB worse in pictures.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.export.microfacet import COAT_F0, MAX_DIELECTRIC_F0, Surfaces, ggx, joined, schlick
from analysis.reflectance.models import Cosines, cosines_from_angles

Array = NDArray[Any]
"""Curves and what is made of them have 32 bits: it is the search that takes time, and colours need no more."""

ROUGHNESS = np.geomspace(0.06, 1.0, 48)
"""Grid of roughness that is searched; the best lies between its nodes by a parabola."""

MAX_METAL_ROUGHNESS = 0.7
"""A rougher metal is a matte surface in disguise, which renderers with multiple scattering brighten."""

METALLIC = (1.0, 0.25, 0.5, 0.75)
"""What is tried where a dielectric does not do."""

METAL_GAIN = 0.5
"""A surface is metallic if that leaves less than this share of the dielectric's squared error."""

BETWEEN_GAIN = 0.5
"""It is so in part, which hardly any material is, if that leaves less than this share of the whole metal's."""

COAT_GAIN = 0.5
"""A coat is kept if it leaves less than this share of the squared error without it."""

GOOD_ENOUGH = 0.03
"""Relative error of a dielectric up to which nothing else is tried."""

_MAX_THETA_H_DEG = 65.0
_THETA_D_DEG = np.array([0.0, 7.5, 15.0, 22.5, 30.0, 45.0])
_FALL_DEG = 15.0  # over theta_d: beyond the slice the curves are extrapolated, and more so the farther
_FLOOR = 0.1  # of the mean: below it errors no longer count relative to the value
_BLACK = 1e-6  # 1/sr; a floor below it tells nothing, and its square leaves what 32 bits hold
_TILE = 1024
_ROUNDS = 4  # of weight and rest by turns
_COARSE = slice(1, None, 3)  # of the grid, for pairs of lobes


@dataclass(frozen=True)
class Samples:
    """Directions at which curves are compared.

    Attributes
    ----------
    cosines : Cosines
        Of shape (S,).
    weight : ndarray, shape (S,)
        Their sum is 1.
    theta_h : ndarray, shape (S,)
        Half angles, rad.
    azimuth : ndarray, shape (S,)
        Which pair of theta_d and phi_d each has.
    """

    cosines: Cosines
    weight: Array
    theta_h: Array
    azimuth: NDArray[np.int64]

    def within(self, seen: Array) -> NDArray[np.int64]:
        """Return for half angles (P,) in rad the sample (P, S) that stands for each: itself, or the last one within.

        The other two angles stay the same; samples of one pair of them follow each other by their half angle.
        """
        nodes = np.unique(self.theta_h)
        last = np.clip(np.searchsorted(nodes, seen, side="right") - 1, 0, len(nodes) - 1)
        node = np.minimum(np.searchsorted(nodes, self.theta_h)[None], last[:, None])
        number = np.full((len(nodes), self.azimuth.max() + 1), -1)
        number[np.searchsorted(nodes, self.theta_h), self.azimuth] = np.arange(len(self.theta_h))
        return number[node, self.azimuth[None]]


@cache
def comparison_samples() -> Samples:
    """Return even half angles to 65 deg, theta_d to 45 deg weighted exp(-theta_d / 15 deg), phi_d 0 and 90 deg."""
    theta_h = np.deg2rad(np.arange(0.0, _MAX_THETA_H_DEG + 0.1, 2.5))
    steps = np.gradient(_THETA_D_DEG)
    steps[[0, -1]] /= 2.0
    over_d = steps * np.exp(-_THETA_D_DEG / _FALL_DEG)
    h, d, phi = np.meshgrid(theta_h, np.deg2rad(_THETA_D_DEG), np.array([0.0, np.pi / 2]), indexing="ij")
    cosines, above = cosines_from_angles(h, d, phi)
    weight = np.broadcast_to(over_d[:, None], h.shape)[above]
    kept = Cosines(*(getattr(cosines, name)[above] for name in ("n_dot_h", "cos_d", "n_dot_l", "n_dot_v")))
    azimuth = np.broadcast_to(np.arange(h[0].size).reshape(h.shape[1:]), h.shape)[above]
    return Samples(kept, weight / weight.sum(), h[above], azimuth)


def fit_surfaces(curves: Callable[[NDArray[np.int64]], Array], n: int) -> tuple[Surfaces, Array]:
    """Fit the surface model to `n` BRDFs.

    Parameters
    ----------
    curves : callable
        Takes indices (P,), returns the BRDFs in 1/sr at `comparison_samples`, shape (P, S, 3).
    n : int

    Returns
    -------
    surfaces : Surfaces
    error : ndarray, shape (n,)
        Root of the weighted mean of the squared error relative to the value.
    """

    def fit_from(first: int) -> tuple[Surfaces, Array]:
        return _fit_tile(curves(np.arange(first, min(first + _TILE, n))))

    if n == 0:
        return Surfaces(np.zeros((0, 3)), *(np.zeros(0) for _ in range(5))), np.zeros(0)
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        parts = list(pool.map(fit_from, range(0, n, _TILE)))
    return joined([surfaces for surfaces, _ in parts]), np.concatenate([error for _, error in parts])


class _Basis(NamedTuple):
    """What a surface of stated roughness is made of: f = k u + F0 v + t, with u = (1 - s) / pi.

    v = (1 - s) GGX and t = s GGX over the samples, s = (1 - cos theta_d)^5, k = (1 - F0) colour. Shape (R, S), R values
    of roughness. Of a metal f = colour v + t: `_Moments.metallic` has what lies between.
    """

    u: Array
    v: Array
    t: Array


def _basis(roughness: Array) -> _Basis:
    cosines = comparison_samples().cosines
    s = schlick(cosines.cos_d)
    lobe = ggx(cosines, roughness[:, None] ** 2)
    return _Basis(*(a.astype(np.float32) for a in ((1.0 - s) / np.pi, (1.0 - s) * lobe, s * lobe)))


def _coat_basis(roughness: Array) -> Array:
    cosines = comparison_samples().cosines
    return (COAT_F0 + (1.0 - COAT_F0) * schlick(cosines.cos_d)) * ggx(cosines, roughness[:, None] ** 2)


def _fit_tile(f: Array) -> tuple[Surfaces, Array]:
    """Fit surfaces to curves of shape (P, S, 3)."""
    f = np.ascontiguousarray(f.transpose(0, 2, 1), np.float32)
    # One floor for the channels together: a channel that is nearly black is nothing anybody sees.
    floor = _FLOOR * np.mean(f, axis=(1, 2))[:, None, None]
    W = comparison_samples().weight.astype(np.float32) / (f + np.maximum(floor, _BLACK)) ** 2 / 3.0
    m = _moments(f, W, _basis(ROUGHNESS))
    surfaces, cost = _one_lobe(f, W, m)
    tried = np.flatnonzero(cost > GOOD_ENOUGH**2)
    rows, coated, coated_cost = _coated(f[tried], W[tried], m.rows(tried), COAT_GAIN * cost[tried])
    better = coated_cost < COAT_GAIN * cost[tried[rows]]
    kept = tried[rows[better]]
    cost[kept] = coated_cost[better]
    surfaces = _replaced(surfaces, kept, coated.select(better))
    return surfaces, np.sqrt(np.maximum(cost, 0.0))


def _replaced(surfaces: Surfaces, index: NDArray[np.int64], by: Surfaces) -> Surfaces:
    order = np.arange(len(surfaces.metallic))
    order[index] = len(order) + np.arange(len(index))
    return joined([surfaces, by]).select(order)


class _Moments(NamedTuple):
    """Sums over the samples of W times products, of P curves in 3 channels and R values of roughness.

    uu (P, 3, 1) and, of shape (P, 3, R), uv, vv, uy, vy, yy with y = f - t.
    """

    uu: Array
    uv: Array
    vv: Array
    uy: Array
    vy: Array
    yy: Array

    def nodes(self, which: slice) -> _Moments:
        """Return the moments at some of the values of roughness."""
        return _Moments(self.uu, *(a[..., which] for a in self[1:]))

    def rows(self, which: NDArray[np.int64]) -> _Moments:
        """Return the moments of some curves."""
        return _Moments(*(a[which] for a in self))

    def metallic(self, metallic: Array, f0: Array) -> _Moments:
        """Return the moments for u' = (1 - m) u + m v / (1 - F0) and v' = (1 - m) v in place of u and v.

        k then tells of the metal as well; F0, which stands in it, is taken from a fit before.
        """
        a, b = 1.0 - metallic, metallic / (1.0 - f0)
        return _Moments(
            uu=a**2 * self.uu + 2.0 * a * b * self.uv + b**2 * self.vv,
            uv=a**2 * self.uv + a * b * self.vv,
            vv=a**2 * self.vv,
            uy=a * self.uy + b * self.vy,
            vy=a * self.vy,
            yy=self.yy,
        )


def _moments(f: Array, W: Array, basis: _Basis) -> _Moments:
    u, v, t = basis
    Wf = W * f
    products = np.concatenate([u * v, v * v, u * t, v * t, t * t])
    uv, vv, ut, vt, tt = np.split(W @ products.T, 5, axis=-1)
    fv, ft = np.split(Wf @ np.concatenate([v, t]).T, 2, axis=-1)
    uu, fu, ff = W @ u**2, Wf @ u, np.sum(Wf * f, axis=-1)
    return _Moments(uu[..., None], uv, vv, fu[..., None] - ut, fv - vt, ff[..., None] - 2.0 * ft + tt)


def _dielectric(m: _Moments) -> tuple[Array, Array, Array]:
    """Return k (P, 3, R), F0 (P, R) and the cost (P, R) within their bounds."""
    slope = m.uv / m.uu
    schur = np.sum(m.vv - slope * m.uv, axis=1)
    F = _clipped(np.sum(m.vy - slope * m.uy, axis=1), schur, MAX_DIELECTRIC_F0)
    k = m.uy / m.uu
    for _ in range(2):
        k = np.clip((m.uy - F[:, None] * m.uv) / m.uu, 0.0, 1.0 - F[:, None])
        # Channels that stand at a bound no longer give way to F0.
        free = (k > 0.0) & (k < 1.0 - F[:, None])
        right = np.where(free, m.vy - slope * m.uy, m.vy - k * m.uv)
        left = np.where(free, m.vv - slope * m.uv, m.vv)
        F = _clipped(np.sum(right, axis=1), np.sum(left, axis=1), MAX_DIELECTRIC_F0)
    k = np.clip((m.uy - F[:, None] * m.uv) / m.uu, 0.0, 1.0 - F[:, None])
    Fc = F[:, None]
    parts = k**2 * m.uu + Fc**2 * m.vv + 2.0 * k * Fc * m.uv - 2.0 * (k * m.uy + Fc * m.vy) + m.yy
    return k, F, np.sum(parts, axis=1)


def _clipped(numerator: Array, denominator: Array, high: float) -> Array:
    positive = denominator > 0.0
    return np.asarray(np.clip(np.where(positive, numerator / np.where(positive, denominator, 1.0), 0.0), 0.0, high))


def _one_lobe(f: Array, W: Array, m: _Moments) -> tuple[Surfaces, Array]:
    """Fit curves (P, 3, S) without a coat; return surfaces and cost (P,)."""
    cost = _dielectric(m)[2]
    metallic = np.zeros(len(f))
    tried = np.flatnonzero(cost.min(axis=1) > GOOD_ENOUGH**2)
    smooth = m.rows(tried).nodes(slice(0, int(np.count_nonzero(ROUGHNESS <= MAX_METAL_ROUGHNESS))))
    wanted = METAL_GAIN * cost[tried].min(axis=1)
    for share in METALLIC:
        f0 = 0.5 * MAX_DIELECTRIC_F0 if share < 1.0 else 0.0
        found = _dielectric(smooth.metallic(np.array(share), np.array(f0)))[2]
        least = found.min(axis=1)
        better = least < wanted
        wanted = np.where(better, least, wanted) * (BETWEEN_GAIN if share == 1.0 else 1.0)
        metallic[tried[better]] = share
        cost[tried[better]] = np.inf
        cost[tried[better], : found.shape[1]] = found[better]
    roughness = _between_nodes(cost)
    return _at_roughness(f, W, roughness, metallic, np.zeros(len(f)), roughness)


def _between_nodes(cost: Array) -> Array:
    """Return the roughness of least cost, cost (P, R) over the grid, by a parabola through the best three nodes."""
    best = cost.argmin(axis=1)
    inner = np.clip(best, 1, cost.shape[1] - 2)
    left, middle, right = (np.take_along_axis(cost, (inner + i)[:, None], axis=1)[:, 0] for i in (-1, 0, 1))
    finite = np.isfinite(left) & np.isfinite(right)
    bend = np.where(finite, left - 2.0 * middle + right, 0.0)
    slope = np.where(finite, left - right, 0.0)
    step = np.where(bend > 0.0, 0.5 * slope / np.where(bend > 0.0, bend, 1.0), 0.0)
    at = np.where(best == inner, inner + np.clip(step, -0.5, 0.5), best)
    return np.asarray(np.exp(np.interp(at, np.arange(len(ROUGHNESS)), np.log(ROUGHNESS))))


def _at_roughness(
    f: Array, W: Array, roughness: Array, metallic: Array, coat: Array, coat_roughness: Array
) -> tuple[Surfaces, Array]:
    """Fit colour, F0 and the coat's weight at stated roughness, all of shape (P,); a coat of weight 0 stays away.

    The coat takes light from what is below it, so that its weight and the rest are fitted in turn; so are F0 and the
    color of what is metallic in part.
    """
    u, v, t = _basis(roughness)
    r, m = _coat_basis(coat_roughness), metallic[:, None]
    below = COAT_F0 + (1.0 - COAT_F0) * schlick(comparison_samples().cosines.n_dot_v)
    w, F = coat, np.where(metallic < 1.0, 0.5 * MAX_DIELECTRIC_F0, 0.0)
    color, base = f[..., 0], f
    for _ in range(_ROUNDS if coat.any() or metallic.any() else 1):
        dim = 1.0 - w[:, None] * below
        moments = _row_moments(f - (w[:, None] * r)[:, None], W, u * dim, v * dim, t * dim)
        k, F, _ = (a[..., 0] for a in _dielectric(moments.metallic(m[..., None], F[:, None, None])))
        color = np.clip(k / (1.0 - F[:, None]), 0.0, 1.0)
        diffuse = (1.0 - m) * (1.0 - F[:, None]) * u
        base = color[..., None] * (diffuse + m * v)[:, None] + ((1.0 - m) * F[:, None] * v + t)[:, None]
        gain = r[:, None] - below * base
        numerator = np.sum(W * gain * (f - base), axis=(1, 2))
        w = np.where(coat > 0.0, _clipped(numerator, np.sum(W * gain**2, axis=(1, 2)), 1.0), 0.0)
    model = base * (1.0 - w[:, None] * below)[:, None] + (w[:, None] * r)[:, None]
    surfaces = Surfaces(
        base_color=color,
        metallic=metallic,
        # Of a metal it says nothing, but some programs weigh metals by it too.
        f0=np.where(metallic < 1.0, F, MAX_DIELECTRIC_F0),
        roughness=roughness,
        clearcoat=w,
        clearcoat_roughness=np.where(w > 0.0, coat_roughness, 0.0),
    )
    return surfaces, np.sum(W * (model - f) ** 2, axis=(1, 2))


def _row_moments(f: Array, W: Array, u: Array, v: Array, t: Array) -> _Moments:
    """Return the moments of curves (P, 3, S) that each have a basis (P, S) of their own; R is 1."""
    u, v, y = (np.broadcast_to(a, f.shape) for a in (u[:, None], v[:, None], f - t[:, None]))

    def total(a: Array, b: Array) -> Array:
        return np.asarray(np.einsum("pcs,pcs,pcs->pc", W, a, b))[..., None]

    return _Moments(total(u, u), total(u, v), total(v, v), total(u, y), total(v, y), total(y, y))


def _coated(f: Array, W: Array, m: _Moments, wanted: Array) -> tuple[NDArray[np.int64], Surfaces, Array]:
    """Fit dielectrics with a coat, smoother than what is below it, where the best pair of lobes costs less than wanted.

    Returns the rows of `f` (P, 3, S) that were fitted, their surfaces and their cost.
    """
    grid = ROUGHNESS[_COARSE]
    costs, pairs = _pair_costs(f, W, m.nodes(_COARSE), grid)
    rows = np.flatnonzero(costs.min(axis=1) < wanted)
    base, coat = pairs[costs[rows].argmin(axis=1)].T
    fitted = _at_roughness(f[rows], W[rows], grid[base], np.zeros(len(rows)), np.ones(len(rows)), grid[coat])
    return rows, *fitted


def _pair_costs(f: Array, W: Array, m: _Moments, grid: Array) -> tuple[Array, NDArray[np.int64]]:
    """Return the cost (P, n) of pairs of lobes, and the indices (n, 2) into `grid` of base and coat.

    What the coat takes from the base is left out here: it is a few percent, and only the best pair is looked for.
    """
    basis, r = _basis(grid), _coat_basis(grid)
    Wf = W * f
    ur, rr, fr = W @ (basis.u * r).T, W @ (r * r).T, Wf @ r.T
    pairs = np.array([(i, j) for i in range(len(grid)) for j in range(i)])
    base, coat = pairs.T
    vr, tr = np.split(W @ np.concatenate([basis.v[base] * r[coat], basis.t[base] * r[coat]]).T, 2, axis=-1)
    of_base = _Moments(m.uu, *(a[..., base] for a in m[1:]))
    return _pair_cost(of_base, ur[..., coat], rr[..., coat], vr, fr[..., coat] - tr), pairs


def _pair_cost(m: _Moments, ur: Array, rr: Array, vr: Array, ry: Array) -> Array:
    """Return the least cost (P, n) over k, F0 and the coat's weight w, by turns; moments of shape (P, 3, n)."""
    uu, uv, vv, uy, vy, yy = m
    F = w = np.zeros((len(uu), uv.shape[-1]))
    # k is eliminated where it is free; F0 and w are then a small box-constrained problem, solved by turns.
    M_vv, M_vr, M_rr = (np.sum(a - b, axis=1) for a, b in ((vv, uv**2 / uu), (vr, uv * ur / uu), (rr, ur**2 / uu)))
    b_v, b_r = np.sum(vy - uv * uy / uu, axis=1), np.sum(ry - ur * uy / uu, axis=1)
    for _ in range(8):
        F = _clipped(b_v - M_vr * w, M_vv, MAX_DIELECTRIC_F0)
        w = _clipped(b_r - M_vr * F, M_rr, 1.0)
    F, w = F[:, None], w[:, None]
    k = np.clip((uy - F * uv - w * ur) / uu, 0.0, 1.0)
    squares = k**2 * uu + F**2 * vv + w**2 * rr + 2.0 * (k * F * uv + k * w * ur + F * w * vr)
    return np.asarray(np.sum(squares - 2.0 * (k * uy + F * vy + w * ry) + yy, axis=1))
