"""How different two displayed colours look: CIEDE2000 [sharma2005]."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from instrument.pictures.srgb import linear_from_srgb

Array = NDArray[np.float64]

_XYZ_FROM_SRGB = np.array(
    [[0.4124564, 0.3575761, 0.1804375], [0.2126729, 0.7151522, 0.0721750], [0.0193339, 0.1191920, 0.9503041]]
)

_D65 = _XYZ_FROM_SRGB.sum(axis=1)


def lab_from_srgb(display: Array) -> Array:
    """Return CIE L*a*b* under D65 of sRGB colours 0 to 1, last axis 3."""
    t = linear_from_srgb(display) @ _XYZ_FROM_SRGB.T / _D65
    f = np.where(t > (6 / 29) ** 3, np.cbrt(t), t / (3 * (6 / 29) ** 2) + 4 / 29)
    return np.stack([116 * f[..., 1] - 16, 500 * (f[..., 0] - f[..., 1]), 200 * (f[..., 1] - f[..., 2])], axis=-1)


def ciede2000(first: Array, second: Array) -> Array:
    """Return the difference of L*a*b* colours, last axis dropped; about 1 is just visible.

    References
    ----------
    [sharma2005]_, eq. 2 to 22, with k_L = k_C = k_H = 1.
    """
    L1, L2 = first[..., 0], second[..., 0]
    chroma = 0.5 * (np.hypot(first[..., 1], first[..., 2]) + np.hypot(second[..., 1], second[..., 2]))
    G = 0.5 * (1 - _saturating(chroma))
    C1, h1 = _polar((1 + G) * first[..., 1], first[..., 2])
    C2, h2 = _polar((1 + G) * second[..., 1], second[..., 2])
    grey = C1 * C2 == 0
    turn = np.where(grey, 0.0, (h2 - h1 + 180) % 360 - 180)
    dL, dC, dH = L2 - L1, C2 - C1, 2 * np.sqrt(C1 * C2) * _sin(turn / 2)
    C, h = 0.5 * (C1 + C2), np.where(grey, h1 + h2, _mean_hue(h1, h2))
    T = 1 - 0.17 * _cos(h - 30) + 0.24 * _cos(2 * h) + 0.32 * _cos(3 * h + 6) - 0.20 * _cos(4 * h - 63)
    level = (0.5 * (L1 + L2) - 50) ** 2
    S_L, S_C, S_H = 1 + 0.015 * level / np.sqrt(20 + level), 1 + 0.045 * C, 1 + 0.015 * C * T
    R_T = -2 * _saturating(C) * _sin(60 * np.exp(-(((h - 275) / 25) ** 2)))
    dL, dC, dH = dL / S_L, dC / S_C, dH / S_H
    return np.asarray(np.sqrt(dL**2 + dC**2 + dH**2 + R_T * dC * dH))


def _saturating(chroma: Array) -> Array:
    return np.asarray(np.sqrt(chroma**7 / (chroma**7 + 25.0**7)))


def _polar(a: Array, b: Array) -> tuple[Array, Array]:
    return np.hypot(a, b), np.rad2deg(np.arctan2(b, a)) % 360


def _mean_hue(h1: Array, h2: Array) -> Array:
    total = h1 + h2
    far = np.abs(h1 - h2) > 180
    return np.asarray(0.5 * np.where(far, np.where(total < 360, total + 360, total - 360), total))


def _cos(degrees: Array) -> Array:
    return np.asarray(np.cos(np.deg2rad(degrees)))


def _sin(degrees: Array) -> Array:
    return np.asarray(np.sin(np.deg2rad(degrees)))
