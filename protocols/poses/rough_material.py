"""A rough model of what a pixel shows: GGX over a Lambertian base [walter2007], [heitz2014].

It only has to say which views tell much; the analysis has models of its own and shares nothing with this one.
Every function takes complex numbers too, so that its derivatives come from a complex step [squire1998].
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Numbers = NDArray[np.floating[Any] | np.complexfloating[Any, Any]]
"""Real, or complex where a derivative is taken."""

PARAMETERS = ("tangent_1", "tangent_2", "log_albedo", "log_f0", "log_alpha")
"""Unknowns of a pixel: its normal's slopes along two tangents, and the logarithms of its material's numbers."""


def normal(frame: Numbers, slope_1: Numbers, slope_2: Numbers) -> Numbers:
    """Return the unit normals n of slopes along the tangents of `frame`, shape (K, 3).

    Parameters
    ----------
    frame : ndarray, shape (K, 3, 3)
        Rows: two unit tangents and the normal where both slopes are 0.
    slope_1, slope_2 : ndarray, shape (K,)
    """
    n = frame[:, 2] + slope_1[:, None] * frame[:, 0] + slope_2[:, None] * frame[:, 1]
    return unit(n)


def brdf(material: Numbers, n_l: Numbers, n_v: Numbers, n_h: Numbers, v_h: Numbers) -> Numbers:
    """Return f = albedo / pi + D G F, 1/sr.

    Parameters
    ----------
    material : ndarray, shape (..., 3)
        Logarithms of albedo, f0 and alpha.
    n_l, n_v, n_h, v_h : ndarray
        Cosines; they broadcast with the leading axes of `material`.
    """
    albedo, f0, alpha = np.moveaxis(np.exp(material), -1, 0)
    a2 = alpha**2
    D = a2 / (np.pi * (n_h**2 * (a2 - 1.0) + 1.0) ** 2)
    # Height-correlated masking over 4 n.l n.v.
    G = 0.5 / (n_l * np.sqrt(a2 + (1.0 - a2) * n_v**2) + n_v * np.sqrt(a2 + (1.0 - a2) * n_l**2))
    F = f0 + (1.0 - f0) * (1.0 - v_h) ** 5
    return np.asarray(albedo / np.pi + D * G * F)


def radiance(unknowns: Numbers, frame: Numbers, to_lens: Numbers, to_light: Numbers, distance: float) -> Numbers:
    """Return L = f n.l (distance / |to_light|)^2 pi: 1 for a white plate that faces the light; shape (V, K).

    Parameters
    ----------
    unknowns : ndarray, shape (K, 5)
        In the order of `PARAMETERS`.
    frame : ndarray, shape (K, 3, 3)
        As of `normal`.
    to_lens, to_light : ndarray, shape (V, K, 3)
        From each of K surface points, in V views, mm.
    distance : float
        At which the plate is, mm.
    """
    n = normal(frame, unknowns[:, 0], unknowns[:, 1])
    omega_o, omega_i = unit(to_lens), unit(to_light)
    h = unit(omega_i + omega_o)
    n_l = dot(n, omega_i)
    f = brdf(unknowns[:, 2:], n_l, dot(n, omega_o), dot(n, h), dot(omega_o, h))
    return np.asarray(np.pi * f * n_l * distance**2 / dot(to_light, to_light))


def dot(a: Numbers, b: Numbers) -> Numbers:
    """Return the sum of products over the last axis, nothing conjugated."""
    return np.asarray(np.einsum("...i,...i->...", a, b))


def unit(vectors: Numbers) -> Numbers:
    """Return vectors of length 1, shape as `vectors`."""
    return np.asarray(vectors / np.sqrt(dot(vectors, vectors))[..., None])
