"""The portable surface model: glTF's metallic-roughness with a specular strength and a clear coat."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.models import Cosines

Array = NDArray[np.float64]

MAX_DIELECTRIC_F0 = 0.08
"""Reflectance at normal incidence of the densest dielectric that renderers' sliders know: an index of 1.79."""

MIN_ALPHA = 1e-3
"""Of a lobe: a perfect mirror has no value."""

COAT_F0 = 0.04
"""Of every clear coat: an index of 1.5."""


@dataclass(frozen=True)
class Surfaces:
    """Parameters of P surfaces.

    Attributes
    ----------
    base_color : ndarray, shape (P, 3)
        Linear Rec. 709, 0 to 1: albedo of a dielectric, reflectance at normal incidence of a metal.
    metallic : ndarray, shape (P,)
        1 = metal, 0 = dielectric; between them a pixel that holds some of each.
    f0 : ndarray, shape (P,)
        Reflectance at normal incidence of a dielectric, 0 to `MAX_DIELECTRIC_F0`; the latter of a metal.
    roughness : ndarray, shape (P,)
        alpha = roughness squared.
    clearcoat, clearcoat_roughness : ndarray, shape (P,)
        Weight of the coat, 0 to 1, and its roughness.
    """

    base_color: Array
    metallic: Array
    f0: Array
    roughness: Array
    clearcoat: Array
    clearcoat_roughness: Array

    def select(self, index: NDArray[np.int64] | NDArray[np.bool_]) -> Surfaces:
        """Return some of them, or each as often as `index` says."""
        return Surfaces(*(getattr(self, field.name)[index] for field in fields(self)))


def joined(parts: list[Surfaces]) -> Surfaces:
    """Join surfaces."""
    names = [field.name for field in fields(Surfaces)]
    return Surfaces(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def schlick(cosine: Array) -> Array:
    """Return (1 - cosine)^5, the share by which a reflectance has risen from F0 to 1 [schlick1994]."""
    return np.asarray((1.0 - cosine) ** 5)


def ggx(cosines: Cosines, alpha: Array) -> Array:
    """Return D G / (4 n.l n.v) of GGX with the height-correlated Smith term, 1/sr.

    References
    ----------
    D: [walter2007]_, eq. 33; G: [heitz2014]_, eq. 99, as glTF's viewers have it.
    """
    a2 = np.maximum(alpha, MIN_ALPHA) ** 2
    c, x_i, x_o = cosines.n_dot_h, cosines.n_dot_l, cosines.n_dot_v
    D = a2 / (np.pi * (c**2 * (a2 - 1.0) + 1.0) ** 2)
    Lambda = x_i * np.sqrt(a2 + (1.0 - a2) * x_o**2) + x_o * np.sqrt(a2 + (1.0 - a2) * x_i**2)
    return np.asarray(D * 0.5 / Lambda)


def evaluate(surfaces: Surfaces, cosines: Cosines) -> Array:
    """Return the BRDF of each surface in 1/sr, shape (P, ..., 3), at `cosines` of shape (P, ...) or (1, ...).

    Dielectric: (1 - F) color / pi + F GGX with F = F0 + (1 - F0) (1 - omega_o.h)^5; metal: F GGX with color for F0; the
    base is metallic of the one and the rest of the other. A coat of weight w adds w F_c GGX_c and leaves 1 - w F_c(n.v)
    of what is below it. Between dielectric and metal both are mixed, as glTF 2.0 has it (appendix B).
    """
    shape = (len(surfaces.metallic), *(1,) * (cosines.n_dot_h.ndim - 1))

    def of_all(values: Array) -> Array:
        return values.reshape(shape)

    s, metallic = schlick(cosines.cos_d), of_all(surfaces.metallic)
    lobe = ggx(cosines, of_all(surfaces.roughness**2))
    coat_lobe = ggx(cosines, of_all(surfaces.clearcoat_roughness**2))
    w = of_all(surfaces.clearcoat)
    below = 1.0 - w * (COAT_F0 + (1.0 - COAT_F0) * schlick(cosines.n_dot_v))
    coat = w * (COAT_F0 + (1.0 - COAT_F0) * s) * coat_lobe
    F = of_all(surfaces.f0) + (1.0 - of_all(surfaces.f0)) * s
    channels = []
    for ch in range(surfaces.base_color.shape[1]):
        color = of_all(surfaces.base_color[:, ch])
        dielectric = (1.0 - F) * color / np.pi + F * lobe
        metal = (color + (1.0 - color) * s) * lobe
        channels.append(((1.0 - metallic) * dielectric + metallic * metal) * below + coat)
    return np.stack(channels, axis=-1)
