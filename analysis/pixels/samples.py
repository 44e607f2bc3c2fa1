"""The samples of one pixel as the solvers take them: directions, radiances freed of geometry, weights, residuals.

With light power P_v and distance d_v, y_v = I_v d_v^2 / P_v is what the BRDF times max(0, n.omega_i) gives.
A view's residual is one number over its channels, so that a wrong view is weighed down as a whole.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.kernel import fast_kernel, kernel

Array = NDArray[np.float64]

MIN_VIEWS = 4
"""Fewest valid views: two unknowns of the normal, one of the albedo, one to spare."""

# Flags of a pixel, one bit each.
TOO_FEW_VIEWS, BLACK, CLIPPED, NOT_CONVERGED, POOR_FIT = 1, 2, 4, 8, 16

OUTLIER = 9.0
"""A view's weight is halved where its chi-square is this many times the expected: 3 sigma."""

NEAR_PLANAR = math.radians(20.0)
"""Prior of a normal's tilt from the plane of the sample, one sigma, where its neighbours have not been asked:
near-planar samples are what this is for. It decides where the samples do not (few views, no highlight) and moves a
normal known to 0.1 deg by 0.00003 of its tilt."""

_LARGE = 1e100  # of a product; a factor more stays within the range of a double


class Samples(NamedTuple):
    """What was measured: P pixels of N views in C channels, radiances as in the registered stack."""

    radiance: NDArray[np.float32]  # [N, P, C], NaN = not seen
    variance: NDArray[np.float32]  # [N, P, C]
    saturated: NDArray[np.uint8]  # [N, P, C]


class Geometry(NamedTuple):
    """Where everything is, in the sample frame, mm."""

    camera_position: NDArray[np.float64]  # [N, 3]
    light_position: NDArray[np.float64]  # [N, 3]
    light_power: NDArray[np.float64]  # [N]; NaN = a view to leave out
    point: NDArray[np.float64]  # [P, 3]
    start: NDArray[np.float64]  # [P, 3] normals to go on from; NaN = none
    prior: NDArray[np.float64]  # [P, 4] unit normal likely beforehand, and its precision a tangent axis, 1/rad^2


class Settings(NamedTuple):
    """How to solve."""

    relative_error: float  # calibration error of a radiance, relative, one sigma
    floor: float  # one sigma that every radiance has at least
    tolerance: float  # gain in chi-square that an atom must bring
    most: int  # atoms that a fit may use
    robust: bool  # weigh down views that do not fit
    shared: bool  # one coefficient for all channels of an atom (a material), not one for each
    cold: bool  # try the cold starts where a given one does not fit


class Pixel(NamedTuple):
    """Scratch of one pixel; C channels, N views."""

    y: NDArray[np.float64]  # [C, N] radiance freed of power and fall-off
    base: NDArray[np.float64]  # [C, N] variance of y without the relative error; inf = no sample
    clipped: NDArray[np.uint8]  # [C, N]
    gain: NDArray[np.float64]  # [N] d^2 / P
    light: NDArray[np.float64]  # [3, N] omega_i
    half: NDArray[np.float64]  # [3, N] h
    prior: NDArray[np.float64]  # [4] as in `Geometry`
    cosine_h: NDArray[np.float64]  # [N]
    cosine_i: NDArray[np.float64]  # [N]
    model: NDArray[np.float64]  # [C, N]
    sigma2: NDArray[np.float64]  # [C, N]
    weight: NDArray[np.float64]  # [C, N]
    chi2: NDArray[np.float64]  # [N]
    share: NDArray[np.float64]  # [N] of each channel in its view's chi2; 0 where the view does not see the pixel


@kernel
def allocate_pixel(n_views: int, n_channels: int) -> Pixel:
    """Allocate the scratch of one pixel."""
    return Pixel(
        np.zeros((n_channels, n_views)),
        np.zeros((n_channels, n_views)),
        np.zeros((n_channels, n_views), np.uint8),
        np.zeros(n_views),
        np.zeros((3, n_views)),
        np.zeros((3, n_views)),
        np.zeros(4),
        np.zeros(n_views),
        np.zeros(n_views),
        np.zeros((n_channels, n_views)),
        np.zeros((n_channels, n_views)),
        np.zeros((n_channels, n_views)),
        np.zeros(n_views),
        np.zeros(n_views),
    )


@kernel
def load(samples: Samples, geometry: Geometry, settings: Settings, p: int, px: Pixel) -> None:
    """Directions of pixel `p`, its radiances freed of power and fall-off, and their variances."""
    n_channels, n_views = px.y.shape
    _load_directions(geometry, p, px)
    for i in range(4):
        px.prior[i] = geometry.prior[p, i]
    for v in range(n_views):
        gain, n_seen = px.gain[v], 0
        for ch in range(n_channels):
            radiance = samples.radiance[v, p, ch]
            variance = samples.variance[v, p, ch]
            px.clipped[ch, v] = samples.saturated[v, p, ch]
            # Until there is a model its bounds count as kept; the last pixel's must not be asked.
            px.model[ch, v] = np.inf
            # A view to leave out has no gain.
            if math.isfinite(radiance * gain) and variance >= 0.0 and math.isfinite(variance):
                px.y[ch, v] = radiance * gain
                px.base[ch, v] = (variance + settings.floor**2) * gain**2
                n_seen += 1
            else:
                px.y[ch, v] = 0.0
                px.base[ch, v] = np.inf
        px.share[v] = 1.0 / n_seen if n_seen > 0 else 0.0


@fast_kernel
def _load_directions(geometry: Geometry, p: int, px: Pixel) -> None:
    x, y, z = geometry.point[p, 0], geometry.point[p, 1], geometry.point[p, 2]
    for v in range(px.gain.shape[0]):
        light_x, light_y, light_z = (
            geometry.light_position[v, 0] - x,
            geometry.light_position[v, 1] - y,
            geometry.light_position[v, 2] - z,
        )
        camera_x, camera_y, camera_z = (
            geometry.camera_position[v, 0] - x,
            geometry.camera_position[v, 1] - y,
            geometry.camera_position[v, 2] - z,
        )
        d2 = light_x * light_x + light_y * light_y + light_z * light_z
        to_light = 1.0 / math.sqrt(d2)
        to_camera = 1.0 / math.sqrt(camera_x * camera_x + camera_y * camera_y + camera_z * camera_z)
        px.gain[v] = d2 / geometry.light_power[v]
        px.light[0, v], px.light[1, v], px.light[2, v] = light_x * to_light, light_y * to_light, light_z * to_light
        half_x = px.light[0, v] + camera_x * to_camera
        half_y = px.light[1, v] + camera_y * to_camera
        half_z = px.light[2, v] + camera_z * to_camera
        norm = 1.0 / math.sqrt(half_x * half_x + half_y * half_y + half_z * half_z)
        px.half[0, v], px.half[1, v], px.half[2, v] = half_x * norm, half_y * norm, half_z * norm


@kernel
def usable(px: Pixel) -> int:
    """Return the flags that can be told before solving."""
    n_channels, n_views = px.y.shape
    seen, bright, clipped = 0, 0, 0
    for v in range(n_views):
        here, lit, lost = False, False, False
        for ch in range(n_channels):
            if math.isfinite(px.base[ch, v]):
                lost = lost or px.clipped[ch, v] > 0
                here = here or px.clipped[ch, v] == 0
                lit = lit or px.y[ch, v] > 3.0 * math.sqrt(px.base[ch, v])
        seen += here
        bright += lit
        clipped += lost
    flags = 0
    if clipped > 0:
        flags |= CLIPPED
    if seen < MIN_VIEWS:
        flags |= TOO_FEW_VIEWS
    if bright < MIN_VIEWS:
        flags |= BLACK
    return flags


@kernel
def plain_weights(px: Pixel, settings: Settings) -> None:
    """Variances and weights of the samples before there is a model."""
    n_channels, n_views = px.y.shape
    for ch in range(n_channels):
        mean, seen = 0.0, 0
        for v in range(n_views):
            if math.isfinite(px.base[ch, v]):
                mean += px.y[ch, v]
                seen += 1
        mean = max(mean / max(seen, 1), 0.0)
        for v in range(n_views):
            # A shadow measured as nearly zero must not get a tiny variance, so the mean stands in below it.
            level = max(px.y[ch, v], mean)
            px.sigma2[ch, v] = px.base[ch, v] + (settings.relative_error * level) ** 2
            px.weight[ch, v] = 1.0 / px.sigma2[ch, v] if px.sigma2[ch, v] > 0.0 else 0.0


@kernel
def robust_weights(px: Pixel, settings: Settings, kappa: float) -> None:
    """Variances and weights by the model; views that do not fit lose weight, 1 / (1 + chi^2 / kappa)."""
    n_channels, n_views = px.y.shape
    for ch in range(n_channels):
        for v in range(n_views):
            px.sigma2[ch, v] = px.base[ch, v] + (settings.relative_error * px.model[ch, v]) ** 2
            px.weight[ch, v] = 1.0 / px.sigma2[ch, v] if px.sigma2[ch, v] > 0.0 else 0.0
    if settings.robust:
        chi2_of_views(px)
        for v in range(n_views):
            w = 1.0 / (1.0 + px.chi2[v] / kappa)
            for ch in range(n_channels):
                px.weight[ch, v] *= w


@fast_kernel
def chi2_of_views(px: Pixel) -> None:
    """Mean over the channels of the squared residual over its variance; none where a bound is kept."""
    n_channels, n_views = px.y.shape
    px.chi2[:] = 0.0
    for ch in range(n_channels):
        for v in range(n_views):
            r = px.y[ch, v] - px.model[ch, v]
            if px.clipped[ch, v] and r < 0.0:
                r = 0.0
            # Without a sample the variance is infinite.
            px.chi2[v] += px.share[v] * r * r / px.sigma2[ch, v] if px.sigma2[ch, v] > 0.0 else 0.0


@kernel
def median_chi2(px: Pixel) -> float:
    """Return the median over the views that see the pixel, as a share of what noise alone would give."""
    chi2_of_views(px)
    seen = np.empty(px.chi2.shape[0])
    n_seen = 0
    for v in range(px.chi2.shape[0]):
        if px.share[v] > 0.0:
            seen[n_seen] = px.chi2[v]
            n_seen += 1
    # The median of chi-square with one degree of freedom is 0.455, with three 0.789 of the mean.
    return float(np.sort(seen[:n_seen])[n_seen // 2]) / 0.6 if n_seen > 0 else 1.0


@kernel
def judge_views(px: Pixel) -> tuple[int, int]:
    """Count the views that say anything about the fit, bounds that are kept apart, and those beyond `OUTLIER`."""
    chi2_of_views(px)
    n_telling, n_wrong = 0, 0
    for v in range(px.chi2.shape[0]):
        n_telling += px.chi2[v] > 0.0
        n_wrong += px.chi2[v] > OUTLIER
    return n_telling, n_wrong


@kernel
def robust_cost(px: Pixel, settings: Settings, normal: Array, kappa: float) -> float:
    """Cauchy's loss of the views, kappa log(1 + chi^2 / kappa), or plain chi-square."""
    chi2_of_views(px)
    # |n - n_0|^2, over the channels as the chi-square is.
    along = normal[0] * px.prior[0] + normal[1] * px.prior[1] + normal[2] * px.prior[2]
    total: float = 2.0 * (1.0 - along) * px.prior[3] / px.y.shape[0]
    if not (settings.robust and math.isfinite(kappa)):
        return total + float(np.sum(px.chi2))
    # Logarithms of products, since a logarithm takes longer than all else here.
    product = 1.0
    for v in range(px.chi2.shape[0]):
        product *= 1.0 + px.chi2[v] / kappa
        if product > _LARGE:
            total += kappa * math.log(product)
            product = 1.0
    return total + kappa * math.log(product)


@kernel
def brightness(px: Pixel, v: int) -> float:
    """Sum over the channels of a view's samples; negative where there is none."""
    total, seen = 0.0, 0
    for ch in range(px.y.shape[0]):
        if math.isfinite(px.base[ch, v]):
            total += px.y[ch, v]
            seen += 1
    return max(total / seen, 0.0) if seen > 0 else -1.0
