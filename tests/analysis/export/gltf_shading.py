"""glTF 2.0's surface (appendix B, KHR_materials_specular, KHR_materials_clearcoat), written for the tests.

Shares no code with what is exported: pictures of the written files are made with it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Surface:
    """Parameters of a surface, or of many: of shape (..., 3) the colour, (...) the others."""

    color: Array | tuple[float, float, float]
    f0: Array | float
    roughness: Array | float
    metallic: Array | float = 0.0
    coat: Array | float = 0.0
    coat_roughness: Array | float = 0.0


def specular_brdf(alpha: Array, n_dot_h: Array, n_dot_l: Array, n_dot_v: Array) -> Array:
    """V D of GGX, V with the height-correlated masking of viewers."""
    D = alpha**2 / (np.pi * (n_dot_h * n_dot_h * (alpha**2 - 1.0) + 1.0) ** 2)
    ggx_v = n_dot_l * np.sqrt(n_dot_v * n_dot_v * (1.0 - alpha**2) + alpha**2)
    ggx_l = n_dot_v * np.sqrt(n_dot_l * n_dot_l * (1.0 - alpha**2) + alpha**2)
    return D * 0.5 / (ggx_v + ggx_l)


def gltf_brdf(surface: Surface, n_dot_h: Array, v_dot_h: Array, n_dot_l: Array, n_dot_v: Array) -> Array:
    """Return the BRDF, last axis the channels."""
    c = np.asarray(surface.color, np.float64)
    f0, metallic, coat = (np.asarray(a, np.float64)[..., None] for a in (surface.f0, surface.metallic, surface.coat))
    alpha, coat_alpha = (np.maximum(np.asarray(a), 1e-3) ** 2 for a in (surface.roughness, surface.coat_roughness))
    rise = (1.0 - np.abs(v_dot_h))[..., None] ** 5
    specular = specular_brdf(alpha, n_dot_h, n_dot_l, n_dot_v)[..., None]
    metal = specular * (c + (1.0 - c) * rise)
    fresnel = f0 + (1.0 - f0) * rise
    dielectric = (1.0 - fresnel) * c / np.pi + fresnel * specular
    base = dielectric + metallic * (metal - dielectric)
    coat_brdf = specular_brdf(coat_alpha, n_dot_h, n_dot_l, n_dot_v)[..., None] * (0.04 + 0.96 * rise)
    kept = 1.0 - coat * (0.04 + 0.96 * (1.0 - n_dot_v[..., None]) ** 5)
    return base * kept + coat * coat_brdf


def gltf_picture(surface: Surface, normals: Array, points: Array, camera: Array, light: Array) -> Array:
    """Return the radiance of points (..., 3) in mm under a point light, shape (..., 3)."""
    to_light, to_camera = light - points, camera - points
    d2 = np.sum(to_light**2, axis=-1, keepdims=True)
    L, V = to_light / np.sqrt(d2), to_camera / np.linalg.norm(to_camera, axis=-1, keepdims=True)
    H = (L + V) / np.linalg.norm(L + V, axis=-1, keepdims=True)
    n_dot_l, n_dot_v, n_dot_h = (np.sum(normals * a, axis=-1) for a in (L, V, H))
    lit = np.where((n_dot_l > 0.0) & (n_dot_v > 0.0), n_dot_l, 0.0)[..., None] / d2
    cosines = (np.clip(a, 0.01, 1.0) for a in (n_dot_h, np.sum(V * H, axis=-1), n_dot_l, n_dot_v))
    return gltf_brdf(surface, *cosines) * lit


def psnr(expected: Array, found: Array) -> float:
    """Return how alike two linear pictures look, dB; the 99th percentile of the first is white, NaN is left out."""
    known = np.isfinite(expected).all(axis=-1)
    white = np.percentile(expected[known], 99.0)

    def shown(picture: Array) -> Array:
        x = np.clip(picture[known] / white, 0.0, 1.0)
        return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1.0 / 2.4) - 0.055)

    return float(-10.0 * np.log10(np.mean((shown(expected) - shown(found)) ** 2)))
