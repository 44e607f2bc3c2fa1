"""Reflectance kernels: f(omega_i, omega_o) in 1/sr, without the cosine, one material a table row.

All are isotropic, so five cosines say everything: n.l, n.v, n.h, v.h and l.v.

References
----------
Walter et al., Microfacet models for refraction through rough surfaces, EGSR 2007, eq. 33 (GGX).
Heitz, Understanding the masking-shadowing function, JCGT 3(2), 2014, eq. 99 (height-correlated).
Oren and Nayar, Generalization of Lambert's reflectance model, SIGGRAPH 1994, eq. 30.
Bagher, Soler and Holzschuch, Accurate fitting of measured reflectances using a shifted gamma
micro-facet distribution, EGSR 2012.
"""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from drivers.simulated.rendering.compiling import njit

OREN_NAYAR, MICROFACET, SHIFTED_GAMMA = 0.0, 1.0, 2.0

ROW_LENGTH = 34

Rgb = tuple[float, float, float]

Rows = NDArray[np.float64]


@njit(cache=True, nogil=True, error_model="numpy")
def _oren_nayar(rows: Rows, m: int, n_l: float, n_v: float, l_v: float) -> Rgb:
    s2 = rows[m, 4] * rows[m, 4]
    A = 1.0 - 0.5 * s2 / (s2 + 0.33)
    B = 0.45 * s2 / (s2 + 0.09)
    # sin(alpha) tan(beta) cos(phi_i - phi_o), without a single angle.
    s = max(0.0, l_v - n_l * n_v) / max(n_l, n_v)
    f = (A + B * s) / math.pi
    return rows[m, 1] * f, rows[m, 2] * f, rows[m, 3] * f


@njit(cache=True, nogil=True, error_model="numpy")
def _fifth_power(x: float) -> float:
    x2 = x * x
    return x2 * x2 * x


@njit(cache=True, nogil=True, error_model="numpy")
def _over_base(rho: float, f0: float, specular: float, schlick: float, through: float) -> float:
    F = f0 + (1.0 - f0) * schlick
    # What enters and leaves the base has passed the surface twice; both factors keep it reciprocal.
    return specular * F + rho / math.pi * (1.0 - f0) * (1.0 - f0) * through


@njit(cache=True, nogil=True, error_model="numpy")
def _microfacet(rows: Rows, m: int, n_l: float, n_v: float, n_h: float, v_h: float) -> Rgb:
    a2 = rows[m, 7] * rows[m, 7]
    t = n_h * n_h * (a2 - 1.0) + 1.0
    D = a2 / (math.pi * t * t)
    G = 0.5 / (n_l * math.sqrt(a2 + (1.0 - a2) * n_v * n_v) + n_v * math.sqrt(a2 + (1.0 - a2) * n_l * n_l))
    schlick = _fifth_power(1.0 - v_h)
    through = (1.0 - _fifth_power(1.0 - n_l)) * (1.0 - _fifth_power(1.0 - n_v))
    return (
        _over_base(rows[m, 1], rows[m, 4], D * G, schlick, through),
        _over_base(rows[m, 2], rows[m, 5], D * G, schlick, through),
        _over_base(rows[m, 3], rows[m, 6], D * G, schlick, through),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def _masking(theta: float, lam: float, c: float, k: float, theta_0: float) -> float:
    g = 1.0 + lam * (1.0 - math.exp(c * max(0.0, theta - theta_0) ** k))
    return min(1.0, max(0.0, g))


@njit(cache=True, nogil=True, error_model="numpy")
def _shifted_gamma_channel(rows: Rows, m: int, i: int, n_l: float, n_v: float, n_h: float, v_h: float) -> float:
    rho_d, rho_s, alpha, p = rows[m, i], rows[m, i + 3], rows[m, i + 6], rows[m, i + 9]
    f0, f1, kappa = rows[m, i + 12], rows[m, i + 15], rows[m, i + 18]
    lam, c, k, theta_0 = rows[m, i + 21], rows[m, i + 24], rows[m, i + 27], rows[m, i + 30]
    cos2 = n_h * n_h
    a = alpha + (1.0 - cos2) / (cos2 * alpha)
    D = kappa / (math.pi * cos2 * cos2) * math.exp(-a) / a**p
    F = f0 - f1 * v_h + (1.0 - f0) * _fifth_power(1.0 - v_h)
    G = _masking(math.acos(n_l), lam, c, k, theta_0) * _masking(math.acos(n_v), lam, c, k, theta_0)
    return float(rho_d + rho_s * F * D * G / (n_l * n_v)) / math.pi


@njit(cache=True, nogil=True, error_model="numpy")
def brdf(rows: Rows, m: int, n_l: float, n_v: float, n_h: float, v_h: float, l_v: float) -> Rgb:
    """Return f in 1/sr per channel for one material and one pair of directions.

    Parameters
    ----------
    rows : ndarray, shape (n_materials, ROW_LENGTH)
        A material a row: kind, then its parameters, as `materials` packs them.
    m : int
        Which row.
    n_l, n_v, n_h, v_h, l_v : float
        Cosines between normal, light, view and half vector; n_l and n_v are positive.
    """
    n_l, n_v = min(n_l, 1.0), min(n_v, 1.0)
    n_h, v_h = min(n_h, 1.0), min(max(v_h, 0.0), 1.0)
    if rows[m, 0] == OREN_NAYAR:
        return _oren_nayar(rows, m, n_l, n_v, l_v)
    if rows[m, 0] == MICROFACET:
        return _microfacet(rows, m, n_l, n_v, n_h, v_h)
    return (
        _shifted_gamma_channel(rows, m, 1, n_l, n_v, n_h, v_h),
        _shifted_gamma_channel(rows, m, 2, n_l, n_v, n_h, v_h),
        _shifted_gamma_channel(rows, m, 3, n_l, n_v, n_h, v_h),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def evaluate(rows: Rows, m: int, omega_i: NDArray[np.float64], omega_o: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return f of row `m`, shape (n, 3), for unit directions of shape (n, 3) about the normal (0, 0, 1)."""
    f = np.zeros((omega_i.shape[0], 3))
    for k in range(omega_i.shape[0]):
        i, o = omega_i[k], omega_o[k]
        if i[2] <= 0.0 or o[2] <= 0.0:
            continue
        l_v = i[0] * o[0] + i[1] * o[1] + i[2] * o[2]
        length = math.sqrt(max(2.0 + 2.0 * l_v, 1e-30))
        n_h, v_h = (i[2] + o[2]) / length, (1.0 + l_v) / length
        f[k, 0], f[k, 1], f[k, 2] = brdf(rows, m, i[2], o[2], n_h, v_h, l_v)
    return f
