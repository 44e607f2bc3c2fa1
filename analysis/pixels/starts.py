"""Normals to start a pixel from, and the tangent plane on which they move."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.kernel import kernel
from analysis.pixels.nnls import cholesky, solve_factored
from analysis.pixels.samples import Pixel, brightness

Array = NDArray[np.float64]

N_LIKELY = 3
"""Starts that are nearly always enough: flat, trimmed Lambert, centroid of the highlight."""

_RINGS = (math.radians(30.0), math.radians(55.0))

_N_AROUND = 6

N_STARTS = N_LIKELY + len(_RINGS) * _N_AROUND
"""All of them, with those on rings about the flat one."""


@kernel
def start(kind: int, px: Pixel, normal: Array) -> bool:
    """Write a normal to start from, number `kind` of `N_STARTS`; False if there is none."""
    if kind == 1:
        return _start_trimmed(px, normal)
    if kind == 2:
        return _start_highlight(px, normal)
    normal[:] = 0.0
    normal[2] = 1.0
    if kind >= N_LIKELY:
        ring, place = divmod(kind - N_LIKELY, _N_AROUND)
        # The second ring's starts stand between the first one's.
        azimuth = 2.0 * math.pi * (place + 0.5 * ring) / _N_AROUND
        normal[0] = math.sin(_RINGS[ring]) * math.cos(azimuth)
        normal[1] = math.sin(_RINGS[ring]) * math.sin(azimuth)
        normal[2] = math.cos(_RINGS[ring])
    return True


@kernel
def assign(target: Array, source: Array) -> None:
    """Copy a vector; a loop, since numba's own slice assignment compiles for seconds to word its errors."""
    for i in range(source.shape[0]):
        target[i] = source[i]


@kernel
def normalise(normal: Array) -> bool:
    """Make `normal` a unit vector; False if it vanishes or looks away from the camera's side."""
    norm = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if not norm > 0.0 or normal[2] < 0.1 * norm:
        return False
    normal /= norm
    return True


@kernel
def _start_trimmed(px: Pixel, normal: Array) -> bool:
    """Least-squares Lambert on the views whose residual is not among the largest, three rounds."""
    n_views = px.light.shape[1]
    use = np.zeros(n_views)
    r = np.zeros(n_views)
    for v in range(n_views):
        use[v] = 1.0 if brightness(px, v) >= 0.0 else 0.0
    g, L = np.zeros(3), np.zeros((3, 3))
    for _ in range(3):
        A = np.zeros((3, 3))
        b = np.zeros(3)
        for v in range(n_views):
            if use[v] > 0.0:
                y = brightness(px, v)
                for i in range(3):
                    b[i] += px.light[i, v] * y
                    for j in range(3):
                        A[i, j] += px.light[i, v] * px.light[j, v]
        for i in range(3):
            A[i, i] += 1e-9 * (A[0, 0] + A[1, 1] + A[2, 2]) + 1e-30
        if not cholesky(A, 3, L):
            return False
        solve_factored(L, b, 3, g)
        for v in range(n_views):
            fit = px.light[0, v] * g[0] + px.light[1, v] * g[1] + px.light[2, v] * g[2]
            y = brightness(px, v)
            r[v] = y - max(fit, 0.0) if y >= 0.0 else np.inf
        # Highlights lie above a Lambertian fit, shadows below: keep the middle of the residuals.
        middle = np.sort(r[np.isfinite(r)])
        high = middle[int(0.75 * (middle.size - 1))]
        low = middle[int(0.05 * (middle.size - 1))]
        for v in range(n_views):
            use[v] = 1.0 if math.isfinite(r[v]) and low <= r[v] <= high else 0.0
    assign(normal, g)
    return normalise(normal)


@kernel
def _start_highlight(px: Pixel, normal: Array) -> bool:
    """Mean half vector, weighed by the fourth power of brightness so that the peak decides."""
    normal[:] = 0.0
    peak = 0.0
    for v in range(px.half.shape[1]):
        peak = max(peak, brightness(px, v))
    if peak <= 0.0:
        return False
    for v in range(px.half.shape[1]):
        w = (max(brightness(px, v), 0.0) / peak) ** 4
        for i in range(3):
            normal[i] += w * px.half[i, v]
    return normalise(normal)


@kernel
def tangents(normal: Array, t1: Array, t2: Array) -> None:
    """Two unit vectors that span the tangent plane."""
    # Crossing with the axis of the smallest component keeps away from a vanishing product.
    if abs(normal[0]) <= abs(normal[1]):
        t1[0], t1[1], t1[2] = 0.0, normal[2], -normal[1]
    else:
        t1[0], t1[1], t1[2] = -normal[2], 0.0, normal[0]
    t1 /= math.sqrt(t1[0] ** 2 + t1[1] ** 2 + t1[2] ** 2)
    t2[0] = normal[1] * t1[2] - normal[2] * t1[1]
    t2[1] = normal[2] * t1[0] - normal[0] * t1[2]
    t2[2] = normal[0] * t1[1] - normal[1] * t1[0]
