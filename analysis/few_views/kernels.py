"""One pixel of a scene seen by few views: its slopes and albedo, given the curves of its material and its neighbours.

With slopes p, q (the normal is (-p, -q, 1), normalised), t = sqrt(1 - n.h) and the material k of the pixel, the model
of view v and channel c is, in logarithms,

    m_vc = log(P_v / d_v^2) + log(n.l_v) + a_c + log F_kc(t_v) ,

and a sample's residual is r = log((I + e) / (exp(m) + e)), e a few times the noise of the dark, with Student's t of nu
degrees of freedom. Slopes have a Gaussian prior about those of their neighbourhood, the log albedos a about 0. Channels
err together, so that each weighs less than it would alone. A clipped sample that the model exceeds pulls gently: with
no pull at all a peak that nobody saw would grow.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.kernel import fast_kernel, kernel
from analysis.pixels.nnls import cholesky, solve_factored

Array = NDArray[np.float64]

NU = 4.0
"""Degrees of freedom of Student's t: one sample in a hundred lies beyond 4.6 sigma."""

CLIPPED_PULL = 0.3
"""Weight of a clipped sample that the model exceeds. With 0 the peak of a real card runs to 80 times white."""

N_POINTS = 5
"""Points of a slope's posterior on which means over it are taken: the centre and sqrt(3) sigma to either side."""

_LARGE = 1e200  # of a product; a view more stays within the range of a double

_LOG_MOST = 14.0  # of a radiance over the dark's e: keeps exp within bounds while a curve is still far off

_LEAST_COSINE = 0.02  # n.l below which the shading stays what it is, so that its logarithm has a slope

_MAX_STEP = 0.1  # of a slope

_SETTLED = 1e-4  # fall of the loss below which a step was the last


class Seen(NamedTuple):
    """What was seen of P pixels by V views in C channels, and from where."""

    radiance: NDArray[np.float32]  # [V, P, C], at least 0
    valid: NDArray[np.uint8]  # [V, P, C]; 0 = no sample
    clipped: NDArray[np.uint8]  # [V, P, C]
    half: NDArray[np.float32]  # [V, P, 3] unit half vectors h
    light: NDArray[np.float32]  # [V, P, 3] unit directions l to the light
    log_gain: NDArray[np.float32]  # [V, P] log(P_v / d_v^2)


class Materials(NamedTuple):
    """Materials of the scene, and how far samples and albedos are from them."""

    table: NDArray[np.float64]  # [K, C, T] log F over t, uniform from 0 to 1
    weight: NDArray[np.float64]  # [K] of a sample: its share among the channels over its variance
    albedo_precision: NDArray[np.float64]  # [C, C] of the log albedos
    dark: float  # e


class Field(NamedTuple):
    """The unknowns of the pixels, and what is known of them."""

    material: NDArray[np.int64]  # [P]
    slope: NDArray[np.float64]  # [P, 2] p, q
    albedo: NDArray[np.float64]  # [P, C] logarithms
    prior: NDArray[np.float64]  # [P, 2] the slopes' prior mean
    precision: NDArray[np.float64]  # [P] the prior's, a slope
    loss: NDArray[np.float64]  # [P]
    covariance: NDArray[np.float64]  # [P, 3] pp, pq, qq of the slopes
    n_used: NDArray[np.float64]  # [P] parameters that the samples decided, the priors' part taken off


def copied(field: Field) -> Field:
    """Return a copy of the unknowns, to go back to."""
    return Field(
        field.material.copy(),
        field.slope.copy(),
        field.albedo.copy(),
        field.prior.copy(),
        field.precision.copy(),
        field.loss.copy(),
        field.covariance.copy(),
        field.n_used.copy(),
    )


@kernel
def _look_up(table: Array, t: float) -> tuple[float, float]:
    """Return a tabulated value at t and its slope."""
    n = table.shape[0] - 1
    u = min(t, 1.0) * n
    i = min(int(u), n - 1)
    rise = table[i + 1] - table[i]
    return table[i] + (u - i) * rise, rise * n


@kernel
def _angles(p: float, q: float, seen: Seen, v: int, x: int) -> tuple[float, float, float, float, float, float]:
    """Return t and log n.l, each with its derivatives to p and q."""
    hx, hy, hz = seen.half[v, x, 0], seen.half[v, x, 1], seen.half[v, x, 2]
    lx, ly, lz = seen.light[v, x, 0], seen.light[v, x, 1], seen.light[v, x, 2]
    k = 1.0 / math.sqrt(1.0 + p * p + q * q)
    c = (-p * hx - q * hy + hz) * k
    t = math.sqrt(max(1.0 - c, 1e-6))
    # t^2 = 1 - c, so that dt = -dc / 2t.
    t_p, t_q = (hx * k + c * p * k * k) / (2.0 * t), (hy * k + c * q * k * k) / (2.0 * t)
    s = max((-p * lx - q * ly + lz) * k, _LEAST_COSINE)
    return t, t_p, t_q, math.log(s), (-lx * k - s * p * k * k) / s, (-ly * k - s * q * k * k) / s


@kernel
def _radiance(m: float, e: float) -> float:
    """Return exp(m), bounded while a curve is still far off."""
    return e * math.exp(min(m - math.log(e), _LOG_MOST))


@kernel
def _sample(
    seen: Seen, materials: Materials, k: int, v: int, x: int, c: int, t: float, shade: float
) -> tuple[float, float, float, float]:
    """Return a sample's residual, its weight without Student's, d log(M + e) / dm, and the slope of the curve at t.

    `shade` is log n.l with the log albedo.
    """
    e = materials.dark
    log_f, f_t = _look_up(materials.table[k, c], t)
    M = _radiance(log_f + shade + seen.log_gain[v, x], e)
    r = math.log((seen.radiance[v, x, c] + e) / (M + e))
    w = materials.weight[k]
    if seen.clipped[v, x, c] > 0 and r < 0.0:
        w *= CLIPPED_PULL
    return r, w, M / (M + e), f_t


@fast_kernel
def _loss(x: int, p: float, q: float, a: Array, seen: Seen, materials: Materials, field: Field) -> float:
    n_views, _, n_channels = seen.radiance.shape
    k = field.material[x]
    # The logarithm of a product, since a logarithm takes longer than all else here.
    total: float = 0.0
    product = 1.0
    for v in range(n_views):
        t, _, _, log_s, _, _ = _angles(p, q, seen, v, x)
        for c in range(n_channels):
            if seen.valid[v, x, c] == 0:
                continue
            r, w, _, _ = _sample(seen, materials, k, v, x, c, t, log_s + a[c])
            product *= 1.0 + r * r * w / NU
        if product > _LARGE:
            total += 0.5 * (NU + 1.0) * math.log(product)
            product = 1.0
    total += 0.5 * (NU + 1.0) * math.log(product)
    d_p, d_q = p - field.prior[x, 0], q - field.prior[x, 1]
    total += 0.5 * field.precision[x] * (d_p * d_p + d_q * d_q)
    for c in range(n_channels):
        for d in range(n_channels):
            total += 0.5 * a[c] * materials.albedo_precision[c, d] * a[d]
    return total


@fast_kernel
def _equations(
    x: int, p: float, q: float, a: Array, seen: Seen, materials: Materials, field: Field, J: Array, g: Array
) -> None:
    """Write the normal equations J d = g of a step of (p, q, a) at a pixel."""
    n_views, _, n_channels = seen.radiance.shape
    k = field.material[x]
    J[:] = 0.0
    g[:] = 0.0
    for v in range(n_views):
        t, t_p, t_q, log_s, s_p, s_q = _angles(p, q, seen, v, x)
        for c in range(n_channels):
            if seen.valid[v, x, c] == 0:
                continue
            r, w, m, f_t = _sample(seen, materials, k, v, x, c, t, log_s + a[c])
            w *= (NU + 1.0) / (NU + r * r * w)
            j_p, j_q = m * (f_t * t_p + s_p), m * (f_t * t_q + s_q)
            i = 2 + c
            g[0] += w * j_p * r
            g[1] += w * j_q * r
            g[i] += w * m * r
            J[0, 0] += w * j_p * j_p
            J[1, 0] += w * j_q * j_p
            J[1, 1] += w * j_q * j_q
            J[i, 0] += w * m * j_p
            J[i, 1] += w * m * j_q
            J[i, i] += w * m * m
    for d in range(2):
        J[d, d] += field.precision[x]
    g[0] -= field.precision[x] * (p - field.prior[x, 0])
    g[1] -= field.precision[x] * (q - field.prior[x, 1])
    for c in range(n_channels):
        for d in range(n_channels):
            J[2 + c, 2 + d] += materials.albedo_precision[c, d]
            g[2 + c] -= materials.albedo_precision[c, d] * a[d]


@kernel
def fit_pixels(pixels: NDArray[np.int64], seen: Seen, materials: Materials, field: Field, n_steps: int) -> None:
    """Move slopes and albedos of some pixels to their most likely values by Levenberg-Marquardt, in place.

    Parameters
    ----------
    pixels : ndarray of int
        Indices of the pixels to move.
    seen : Seen
    materials : Materials
    field : Field
        Gone on from, and written to: slopes, albedos, loss, covariance and parameters used.
    n_steps : int
    """
    n_channels = seen.radiance.shape[2]
    n = 2 + n_channels
    J, B, L = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    g, d, unit = np.zeros(n), np.zeros(n), np.zeros(n)
    a, trial = np.zeros(n_channels), np.zeros(n_channels)
    for x in pixels:
        p, q, damping = field.slope[x, 0], field.slope[x, 1], 1e-3
        a[:] = field.albedo[x]
        loss = _loss(x, p, q, a, seen, materials, field)
        for _ in range(n_steps):
            _equations(x, p, q, a, seen, materials, field, J, g)
            before, moved = loss, False
            for _ in range(5):
                B[:] = J
                for i in range(n):
                    B[i, i] *= 1.0 + damping
                if cholesky(B, n, L):
                    solve_factored(L, g, n, d)
                    length = math.hypot(d[0], d[1])
                    scale = min(1.0, _MAX_STEP / length) if length > 0.0 else 1.0
                    for c in range(n_channels):
                        trial[c] = a[c] + scale * d[2 + c]
                    new = _loss(x, p + scale * d[0], q + scale * d[1], trial, seen, materials, field)
                    if new < loss:
                        p, q, loss, moved = p + scale * d[0], q + scale * d[1], new, True
                        a[:] = trial
                        damping *= 0.2
                        break
                damping = 8.0 * damping + 1e-3
            if not moved or before - loss < _SETTLED:
                break
        field.slope[x, 0], field.slope[x, 1], field.loss[x] = p, q, loss
        field.albedo[x] = a
        _equations(x, p, q, a, seen, materials, field, J, g)
        _write_certainty(x, J, L, unit, d, materials, field)


@kernel
def _write_certainty(x: int, J: Array, L: Array, unit: Array, d: Array, materials: Materials, field: Field) -> None:
    """Write the slopes' covariance J^-1 and the number of parameters, n - tr(J^-1 prior)."""
    n = J.shape[0]
    if not cholesky(J, n, L):
        field.covariance[x] = np.inf
        field.n_used[x] = 0.0
        return
    used = float(n)
    for i in range(n):
        unit[:] = 0.0
        unit[i] = 1.0
        solve_factored(L, unit, n, d)
        if i < 2:
            used -= field.precision[x] * d[i]
            field.covariance[x, 2 * i] = d[i]
            field.covariance[x, 1] = d[0]  # of i = 1: the element pq
        else:
            for c in range(n - 2):
                used -= materials.albedo_precision[i - 2, c] * d[2 + c]
    field.n_used[x] = used


@kernel
def _point(field: Field, x: int, j: int) -> tuple[float, float, float]:
    """Return point j of the posterior of a pixel's slopes, and its weight in means."""
    p, q = field.slope[x, 0], field.slope[x, 1]
    if j == 0:
        return p, q, 1.0 / 3.0
    pp, pq, qq = field.covariance[x, 0], field.covariance[x, 1], field.covariance[x, 2]
    first = math.sqrt(max(pp, 1e-12))
    across = pq / first
    side = math.sqrt(3.0) * (1.0 if j % 2 == 1 else -1.0)
    if j <= 2:
        return p + side * first, q + side * across, 1.0 / 6.0
    return p, q + side * math.sqrt(max(qq - across * across, 0.0)), 1.0 / 6.0


@kernel
def predict(pixels: NDArray[np.int64], seen: Seen, materials: Materials, field: Field, out: Array) -> None:
    """Write what views show of some pixels with their most likely slopes, shape (V, len(pixels), C).

    Parameters
    ----------
    pixels : ndarray of int
    seen : Seen
        Its radiances are not looked at.
    materials : Materials
    field : Field
    out : ndarray
    """
    n_views, n_channels = seen.half.shape[0], out.shape[2]
    for i in range(pixels.shape[0]):
        x = pixels[i]
        for v in range(n_views):
            t, _, _, log_s, _, _ = _angles(field.slope[x, 0], field.slope[x, 1], seen, v, x)
            for c in range(n_channels):
                log_f, _ = _look_up(materials.table[field.material[x], c], t)
                out[v, i, c] = _radiance(log_f + log_s + seen.log_gain[v, x] + field.albedo[x, c], materials.dark)


@kernel
def curve_equations(
    first: int,
    last: int,
    seen: Seen,
    materials: Materials,
    field: Field,
    nodes: Array,
    S: Array,
    rhs: Array,
    misfit: Array,
) -> None:
    """Add pixels `first` to `last` - 1 to the normal equations of the log curves, on hats over `nodes` in t.

    Each sample enters at the points of its pixel's posterior (an EM step): at the most likely slopes alone a curve
    would learn the normals' errors as its own width.

    Parameters
    ----------
    first, last : int
    seen : Seen
    materials : Materials
    field : Field
    nodes : ndarray, shape (J,)
    S, rhs : ndarray, shapes (K, C, J, J) and (K, C, J)
        Added to; of S the diagonal and the one above.
    misfit : ndarray, shape (K, 4)
        Added to, by material: weighted squared residuals, how many, and of samples with all channels the same sum
        and that of the products of two channels.
    """
    n_views, _, n_channels = seen.radiance.shape
    n_nodes = nodes.shape[0]
    r, u = np.zeros(n_channels), np.zeros(n_channels)
    for x in range(first, last):
        k = field.material[x]
        for v in range(n_views):
            for j in range(N_POINTS):
                p, q, share = _point(field, x, j)
                t, _, _, log_s, _, _ = _angles(p, q, seen, v, x)
                i = min(max(int(np.searchsorted(nodes, t, "right")) - 1, 0), n_nodes - 2)
                f = min(max((t - nodes[i]) / (nodes[i + 1] - nodes[i]), 0.0), 1.0)
                n_free = 0
                for c in range(n_channels):
                    if seen.valid[v, x, c] == 0:
                        continue
                    r[c], w, m, _ = _sample(seen, materials, k, v, x, c, t, log_s + field.albedo[x, c])
                    u[c] = (NU + 1.0) / (NU + r[c] * r[c] * w)
                    if j == 0 and seen.clipped[v, x, c] == 0:
                        misfit[k, 0] += u[c] * r[c] * r[c]
                        misfit[k, 1] += 1.0
                        n_free += 1
                    w *= u[c] * share
                    S[k, c, i, i] += w * m * m * (1.0 - f) * (1.0 - f)
                    S[k, c, i, i + 1] += w * m * m * (1.0 - f) * f
                    S[k, c, i + 1, i + 1] += w * m * m * f * f
                    rhs[k, c, i] += w * m * r[c] * (1.0 - f)
                    rhs[k, c, i + 1] += w * m * r[c] * f
                if j == 0 and n_free == n_channels:
                    for c in range(n_channels):
                        misfit[k, 2] += u[c] * r[c] * r[c]
                        for d in range(c):
                            misfit[k, 3] += math.sqrt(u[c] * u[d]) * r[c] * r[d]
