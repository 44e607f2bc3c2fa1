"""Reflectance models: each evaluates f(omega_i, omega_o) in 1/sr from the cosines of an isotropic BRDF.

On the slice that a collocated rig sees, theta_d = 0 and cos theta_i = cos theta_o = n.h, so every
model below becomes one curve over theta_h.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

# Below this cosine (89.4 deg) a surface is edge-on: no model is asked beyond it, no division is by less.
GRAZING = 0.01


@dataclass(frozen=True, slots=True)
class Cosines:
    """Angles of a light and a view direction about a normal, as cosines, all of one shape.

    Attributes
    ----------
    n_dot_h, cos_d, n_dot_l, n_dot_v : ndarray
        cos theta_h, cos theta_d, cos theta_i, cos theta_o, the first and the last two at least `GRAZING`.
    """

    n_dot_h: Array
    cos_d: Array
    n_dot_l: Array
    n_dot_v: Array

    @classmethod
    def from_directions(cls, normal: Array, light_direction: Array, view_direction: Array) -> Cosines:
        """Build from unit vectors, last axis 3, broadcast against each other."""
        h = light_direction + view_direction
        h = h / np.linalg.norm(h, axis=-1, keepdims=True)
        return cls(
            n_dot_h=_clipped_dot(normal, h, GRAZING),
            cos_d=_clipped_dot(light_direction, h, 0.0),
            n_dot_l=_clipped_dot(normal, light_direction, GRAZING),
            n_dot_v=_clipped_dot(normal, view_direction, GRAZING),
        )

    @classmethod
    def on_slice(cls, theta_h: Array) -> Cosines:
        """Build the collocated slice theta_d = 0 at half angles `theta_h` in radians."""
        c = np.maximum(np.cos(theta_h), GRAZING)
        return cls(c, np.ones_like(c), c, c)


def _clipped_dot(a: Array, b: Array, low: float) -> Array:
    return np.asarray(np.clip(np.sum(a * b, axis=-1), low, 1.0))


def ggx_visibility(x: Array, alpha: float) -> Array:
    """Return Smith's G1(x) / x of the GGX distribution at cosine `x`, without its factor 2 [walter2007, eq. 34]."""
    return np.asarray(1.0 / (x + np.sqrt(alpha**2 + (1.0 - alpha**2) * x**2)))


def lobe(cosines: Cosines, half_width: float, gamma: float) -> Array:
    """Evaluate a power-law lobe of stated half width at half maximum, 1 at its peak on the slice.

    On the slice it is u^-gamma with u = c^2 + (1 - c^2) / alpha^2, c = cos theta_h: the generalised
    Trowbridge-Reitz shape [burley2012], gamma = 2 being GGX. Away from the slice it gets the shape of a
    microfacet model with Smith shadowing, and the Fresnel term of an index 1.5 [schlick1994]; neither is
    seen by a collocated rig.

    Parameters
    ----------
    half_width : float
        theta_h in radians at which the lobe has fallen to a half.
    gamma : float
        Exponent of the tail.
    """
    alpha = lobe_alpha(half_width, gamma)
    c = cosines.n_dot_h
    u = c**2 + (1.0 - c**2) / alpha**2
    rough = min(alpha, 1.0)
    v = ggx_visibility(cosines.n_dot_l, rough) * ggx_visibility(cosines.n_dot_v, rough)
    fresnel = (0.04 + 0.96 * (1.0 - cosines.cos_d) ** 5) / 0.04
    return np.asarray(u**-gamma * fresnel * v / ggx_visibility(c, rough) ** 2)


def lobe_alpha(half_width: float, gamma: float) -> float:
    """Return alpha such that u(half_width)^-gamma = 1/2."""
    s = np.sin(half_width) ** 2
    return float(np.sqrt(s / (s + 2.0 ** (1.0 / gamma) - 1.0)))


def roll_off(cosines: Cosines, theta_0: float, width: float) -> Array:
    """Evaluate a smooth step over theta_h, 1 well below `theta_0` and 0 well above (radians)."""
    theta = np.arccos(cosines.n_dot_h)
    return np.asarray(1.0 / (1.0 + np.exp((theta - theta_0) / width)) / np.pi)


def sgd(cosines: Cosines, p: NDArray[np.void]) -> Array:
    """Evaluate a shifted-gamma-distribution fit [bagher2012], last axis of the result R, G, B.

    Parameters
    ----------
    p : structured row
        One row of the embedded table: ``rhoD_r`` ... ``theta0_b``.
    """
    return np.stack([_sgd_channel(cosines, p, channel) for channel in "rgb"], axis=-1)


def _sgd_channel(cosines: Cosines, p: NDArray[np.void], channel: str) -> Array:
    rho_d, rho_s, alpha, exponent, f0, f1, kappa, lam, c, k, theta_0 = (
        float(p[f"{name}_{channel}"])
        for name in ("rhoD", "rhoS", "alpha", "p", "F0", "F1", "kap", "lambda", "c", "k", "theta0")
    )
    cos_h2 = cosines.n_dot_h**2
    ax = alpha + (1.0 - cos_h2) / cos_h2 / alpha
    D = kappa / (np.pi * cos_h2**2) * np.exp(-ax) / ax**exponent
    F = f0 - f1 * cosines.cos_d + (1.0 - f0) * (1.0 - cosines.cos_d) ** 5
    G = np.ones_like(D)
    for x in (cosines.n_dot_l, cosines.n_dot_v):
        beyond = np.maximum(np.arccos(x) - theta_0, 0.0)
        G *= np.clip(1.0 + lam * (1.0 - np.exp(c * beyond**k)), 0.0, 1.0)
    return np.asarray(rho_d / np.pi + rho_s / np.pi * F * D * G / (cosines.n_dot_l * cosines.n_dot_v))


def abc(cosines: Cosines, p: NDArray[np.void]) -> Array:
    """Evaluate an ABC microfacet fit [low2012], last axis of the result R, G, B.

    Parameters
    ----------
    p : structured row
        One row of the embedded table: ``kD_r`` ... ``ior``.
    """
    D = (1.0 + float(p["B"]) * (1.0 - cosines.n_dot_h)) ** -float(p["C"])
    F = fresnel_dielectric(cosines.cos_d, float(p["ior"]))
    h_dot = np.maximum(cosines.cos_d, GRAZING)
    G = np.minimum(1.0, 2.0 * cosines.n_dot_h * np.minimum(cosines.n_dot_l, cosines.n_dot_v) / h_dot)
    common = F * D * G / (np.pi * cosines.n_dot_l * cosines.n_dot_v)
    return np.stack([float(p[f"kD_{ch}"]) / np.pi + float(p[f"A_{ch}"]) * common for ch in "rgb"], axis=-1)


def fresnel_dielectric(cos_d: Array, ior: float) -> Array:
    """Return the unpolarised reflectance of a dielectric of real index `ior` (Fresnel's equations)."""
    g = np.sqrt(np.maximum(ior**2 - 1.0 + cos_d**2, 0.0))
    s = (cos_d - g) / (cos_d + g)
    p = (ior**2 * cos_d - g) / (ior**2 * cos_d + g)
    return np.asarray(0.5 * (s**2 + p**2))


def cosines_from_angles(theta_h: Array, theta_d: Array, phi_d: Array) -> tuple[Cosines, NDArray[np.bool_]]:
    """Return the cosines at angles in radians, and where light and view are both above the horizon.

    n.l = cos theta_h cos theta_d - sin theta_h sin theta_d cos phi_d; n.v is the same with phi_d + pi.

    Parameters
    ----------
    theta_h, theta_d, phi_d : ndarray
        Broadcast against each other.
    """
    level = np.cos(theta_h) * np.cos(theta_d) * np.ones_like(phi_d)
    lean = np.sin(theta_h) * np.sin(theta_d) * np.cos(phi_d)
    n_dot_l, n_dot_v = level - lean, level + lean
    cosines = Cosines(
        n_dot_h=np.broadcast_to(np.maximum(np.cos(theta_h), GRAZING), level.shape),
        cos_d=np.broadcast_to(np.cos(theta_d), level.shape),
        # Rounding takes cos^2 + sin^2 beyond 1, where there is no arccosine.
        n_dot_l=np.clip(n_dot_l, GRAZING, 1.0),
        n_dot_v=np.clip(n_dot_v, GRAZING, 1.0),
    )
    return cosines, np.minimum(n_dot_l, n_dot_v) > 0.0
