"""Normal and BRDF curve of one pixel at a time: non-negative least squares inside Levenberg-Marquardt.

With c_v = n.h_v and s_v = max(0, n.omega_i,v), the model of view v and channel ch is

    m_v,ch = sum_k a_ch,k phi_k(c_v) s_v ,   a >= 0 ,

where phi_k are dictionary atoms on the slice theta_d = 0 and radiances have been freed of light power
and inverse-square fall-off. Given n, the a are a small non-negative least-squares problem; n itself
moves on its two tangent parameters by variable projection [kaufman1975]: the Jacobian is projected off
the active atoms, so that a step in n already accounts for the a that follow it.

Scalar numba code without Python objects. A pixel depends on nothing but its own samples, so any tiling
and any number of threads give the same bits.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

from analysis.nnls import MAX_ATOMS, Work, nnls, nnls_work, solve_factored

Array = NDArray[np.float64]
Array32 = NDArray[np.float32]

MIN_VIEWS = 4
"""Fewest valid views: two unknowns of the normal, one of the albedo, one to spare."""

# Flags of a pixel, one bit each.
TOO_FEW_VIEWS, BLACK, CLIPPED, NOT_CONVERGED, POOR_FIT = 1, 2, 4, 8, 16

_OUTLIER = 9.0  # a view's weight is halved where its chi-square is 9 times the expected: 3 sigma
_START_STEPS, _STEPS, _STAGES = 4, 10, 2
NEAR_PLANAR = math.radians(20.0)
"""Prior of a normal's tilt from the plane of the sample, one sigma: near-planar samples are what this is for.
It decides where the samples do not (few views, no highlight) and moves a normal known to 0.1 deg by 0.00003 of
its tilt."""

_PEAK = 3.0
# Atoms narrower than the smallest half angle seen would grow without bound: the curve at theta_h = 0 is
# held to this many times the brightest sample, one sigma. A peak that was seen hardly feels it.
_FEW_VIEWS = 15
_GOOD_FIT = 1.5  # cost a view below which a start has found its minimum and the others are not tried
_SETTLED = 1e-3  # fall of the cost below which the step was the last: it moved the normal by 3 % of its sigma
_LONGEST_STEP = 0.25  # rad; beyond it the slope of a curve means nothing
_CONVERGED_STEP = 1e-5  # rad, about 0.0006 deg
_POOR_FIT = 25.0  # chi-square per degree of freedom: residuals of five times the stated noise


class Samples(NamedTuple):
    """What was measured: P pixels of N views in C channels, radiances as in the registered stack."""

    radiance: NDArray[np.float32]  # [N, P, C], NaN = not seen
    variance: NDArray[np.float32]  # [N, P, C]
    saturated: NDArray[np.uint8]  # [N, P, C]


class Geometry(NamedTuple):
    """Where everything is, in the sample frame, mm."""

    camera_position: NDArray[np.float64]  # [N, 3]
    light_position: NDArray[np.float64]  # [N, 3]
    light_power: NDArray[np.float64]  # [N]
    point: NDArray[np.float64]  # [P, 3]
    start: NDArray[np.float64]  # [P, 3] normals to go on from; NaN = none


class Settings(NamedTuple):
    """How to solve."""

    relative_error: float  # calibration error of a radiance, relative, one sigma
    floor: float  # one sigma that every radiance has at least
    tolerance: float  # gain in chi-square that an atom must bring
    robust: bool  # weigh down views that do not fit


class Solution(NamedTuple):
    """What was found, filled in place."""

    normal: NDArray[np.float64]  # [P, 3]; NaN = not solved
    covariance: NDArray[np.float64]  # [P, 3]: xx, xy, yy of the tangent parameters, rad^2
    reduced_chi2: NDArray[np.float64]  # [P]
    atom: NDArray[np.int16]  # [P, C, MAX_ATOMS]; -1 = none
    coefficient: NDArray[np.float64]  # [P, C, MAX_ATOMS], of the scaled atoms
    flags: NDArray[np.uint8]  # [P]
    n_dot_h_range: NDArray[np.float64]  # [P, 2]: smallest and largest n.h seen


class _Pixel(NamedTuple):
    """Scratch of one pixel; C channels, N views."""

    y: NDArray[np.float64]  # [C, N] radiance freed of power and fall-off
    base: NDArray[np.float64]  # [C, N] variance of y without the relative error; inf = no sample
    clipped: NDArray[np.uint8]  # [C, N]
    light: NDArray[np.float64]  # [N, 3] omega_i
    half: NDArray[np.float64]  # [N, 3] h
    phi: NDArray[np.float32]  # [N + 1, K]; the last row is the peak at theta_h = 0
    target: NDArray[np.float64]  # [N + 1] y of one channel, 0 for the peak
    pull: NDArray[np.float64]  # [N + 1] weight of one channel, that of the peak's prior last
    cosine_h: NDArray[np.float64]  # [N]
    cosine_i: NDArray[np.float64]  # [N]
    model: NDArray[np.float64]  # [C, N]
    sigma2: NDArray[np.float64]  # [C, N]
    weight: NDArray[np.float64]  # [C, N]
    n_active: NDArray[np.int64]  # [C]
    active: NDArray[np.int64]  # [C, MAX_ATOMS]
    a: NDArray[np.float64]  # [C, MAX_ATOMS]
    J: NDArray[np.float64]  # [2, N]
    chi2: NDArray[np.float64]  # [N]


@njit(cache=True, nogil=True)
def solve_pixels(
    samples: Samples,
    geometry: Geometry,
    settings: Settings,
    table: Array32,
    derivative: Array32,
    first: int,
    last: int,
    out: Solution,
) -> None:
    """Solve pixels `first` to `last` - 1 (see the module's docstring), writing into `out`.

    Parameters
    ----------
    samples : Samples
    geometry : Geometry
    settings : Settings
    table, derivative : ndarray of float32, shape (n_nodes, n_atoms)
        `analysis.dictionary.SliceTable`.
    first, last : int
    out : Solution
    """
    n_views, _, n_channels = samples.radiance.shape
    n_atoms = table.shape[1]
    px = _allocate(n_views, n_channels, n_atoms)
    work = nnls_work(n_views + 1, n_atoms)
    normal = np.empty(3)
    best = np.empty(3)
    H = np.empty((2, 2))
    for p in range(first, last):
        _load(samples, geometry, settings, p, px)
        flags = _usable(px)
        if flags & (TOO_FEW_VIEWS | BLACK):
            _write_unsolved(p, flags, out)
            continue
        _weigh(px, settings, False, np.inf)
        best_cost = np.inf
        # A normal that was found before is gone on from; the cold starts are for when there is none.
        warm = math.isfinite(geometry.start[p, 0])
        # Where few samples leave several normals open, a near-planar sample's is the one that flat leads to;
        # where many decide, a Lambertian fit is nearer to it.
        first_start = 0 if n_views < _FEW_VIEWS else 1
        for kind in range(3):
            if warm:
                normal[:] = geometry.start[p]
            elif not _start((kind + first_start) % 3, px, normal):
                continue
            cost, _ = _refine(px, settings, table, derivative, work, normal, H, _OUTLIER, _START_STEPS)
            if cost < best_cost:
                best_cost = cost
                best[:] = normal
            if warm or cost < _GOOD_FIT * n_views:
                break
        normal[:] = best
        converged = False
        # Atoms that were right for a start's normal would keep better ones out.
        px.n_active[:] = 0
        for _ in range(_STAGES):
            _evaluate(px, settings, table, work, normal, np.inf)
            kappa = _OUTLIER * max(1.0, _median_chi2(px))
            _weigh(px, settings, True, kappa)
            _, converged = _refine(px, settings, table, derivative, work, normal, H, kappa, _STEPS)
        if not converged:
            flags |= NOT_CONVERGED
        _write(p, flags, px, normal, H, out)


@njit(cache=True, nogil=True)
def _allocate(n_views: int, n_channels: int, n_atoms: int) -> _Pixel:
    return _Pixel(
        np.zeros((n_channels, n_views)),
        np.zeros((n_channels, n_views)),
        np.zeros((n_channels, n_views), np.uint8),
        np.zeros((n_views, 3)),
        np.zeros((n_views, 3)),
        np.zeros((n_views + 1, n_atoms), np.float32),
        np.zeros(n_views + 1),
        np.zeros(n_views + 1),
        np.zeros(n_views),
        np.zeros(n_views),
        np.zeros((n_channels, n_views)),
        np.zeros((n_channels, n_views)),
        np.zeros((n_channels, n_views)),
        np.zeros(n_channels, np.int64),
        np.zeros((n_channels, MAX_ATOMS), np.int64),
        np.zeros((n_channels, MAX_ATOMS)),
        np.zeros((2, n_views)),
        np.zeros(n_views),
    )


@njit(cache=True, nogil=True)
def _load(samples: Samples, geometry: Geometry, settings: Settings, p: int, px: _Pixel) -> None:
    """Directions of pixel `p`, its radiances freed of power and fall-off, and their variances."""
    n_channels, n_views = px.y.shape
    x = geometry.point[p]
    for v in range(n_views):
        d2, r2 = 0.0, 0.0
        for i in range(3):
            d2 += (geometry.light_position[v, i] - x[i]) ** 2
            r2 += (geometry.camera_position[v, i] - x[i]) ** 2
        norm2 = 0.0
        for i in range(3):
            px.light[v, i] = (geometry.light_position[v, i] - x[i]) / math.sqrt(d2)
            px.half[v, i] = px.light[v, i] + (geometry.camera_position[v, i] - x[i]) / math.sqrt(r2)
            norm2 += px.half[v, i] ** 2
        for i in range(3):
            px.half[v, i] /= math.sqrt(norm2)
        gain = d2 / geometry.light_power[v]
        for ch in range(n_channels):
            radiance = samples.radiance[v, p, ch]
            variance = samples.variance[v, p, ch]
            px.clipped[ch, v] = samples.saturated[v, p, ch]
            if math.isfinite(radiance) and variance >= 0.0 and math.isfinite(variance):
                px.y[ch, v] = radiance * gain
                px.base[ch, v] = (variance + settings.floor**2) * gain**2
            else:
                px.y[ch, v] = 0.0
                px.base[ch, v] = np.inf
    px.n_active[:] = 0


@njit(cache=True, nogil=True)
def _usable(px: _Pixel) -> int:
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


@njit(cache=True, nogil=True)
def _weigh(px: _Pixel, settings: Settings, from_model: bool, kappa: float) -> None:
    """Variances and weights of the samples; those of a clipped one hold while the model stays below it."""
    n_channels, n_views = px.y.shape
    for ch in range(n_channels):
        mean, seen = 0.0, 0
        for v in range(n_views):
            if math.isfinite(px.base[ch, v]):
                mean += px.y[ch, v]
                seen += 1
        mean = max(mean / max(seen, 1), 0.0)
        for v in range(n_views):
            # A shadow measured as nearly zero must not get a tiny variance, so before there is a model
            # the mean stands in below it.
            level = px.model[ch, v] if from_model else max(px.y[ch, v], mean)
            px.sigma2[ch, v] = px.base[ch, v] + (settings.relative_error * level) ** 2
            px.weight[ch, v] = 1.0 / px.sigma2[ch, v] if px.sigma2[ch, v] > 0.0 else 0.0
    if from_model and settings.robust:
        _chi2_of_views(px)
        for v in range(n_views):
            w = 1.0 / (1.0 + px.chi2[v] / kappa)
            for ch in range(n_channels):
                px.weight[ch, v] *= w


@njit(cache=True, nogil=True)
def _chi2_of_views(px: _Pixel) -> None:
    """Mean over the channels of the squared residual over its variance; none where a bound is kept."""
    n_channels, n_views = px.y.shape
    for v in range(n_views):
        total, seen = 0.0, 0
        for ch in range(n_channels):
            if math.isfinite(px.sigma2[ch, v]) and px.sigma2[ch, v] > 0.0:
                r = px.y[ch, v] - px.model[ch, v]
                if px.clipped[ch, v] and r < 0.0:
                    r = 0.0
                total += r * r / px.sigma2[ch, v]
                seen += 1
        px.chi2[v] = total / seen if seen > 0 else 0.0


@njit(cache=True, nogil=True)
def _median_chi2(px: _Pixel) -> float:
    """Return the median over the views that see the pixel, as a share of what noise alone would give."""
    _chi2_of_views(px)
    seen = np.empty(px.chi2.shape[0])
    n_seen = 0
    for v in range(px.chi2.shape[0]):
        if _brightness(px, v) >= 0.0:
            seen[n_seen] = px.chi2[v]
            n_seen += 1
    # The median of chi-square with one degree of freedom is 0.455, with three 0.789 of the mean.
    return float(np.median(seen[:n_seen])) / 0.6 if n_seen > 0 else 1.0


@njit(cache=True, nogil=True)
def _cost(px: _Pixel, settings: Settings, normal: Array, kappa: float) -> float:
    """Cauchy's loss of the views, kappa log(1 + chi^2 / kappa), or plain chi-square."""
    _chi2_of_views(px)
    total: float = 2.0 * (1.0 - normal[2]) / NEAR_PLANAR**2 / px.y.shape[0]
    for v in range(px.chi2.shape[0]):
        robust = settings.robust and math.isfinite(kappa)
        total += kappa * math.log1p(px.chi2[v] / kappa) if robust else px.chi2[v]
    return float(total)


@njit(cache=True, nogil=True)
def _start(kind: int, px: _Pixel, normal: Array) -> bool:
    """Write a normal to start from: flat, trimmed Lambert, centroid of the highlight; False if there is none."""
    if kind == 1:
        return _start_trimmed(px, normal)
    if kind == 2:
        return _start_highlight(px, normal)
    normal[:] = 0.0
    normal[2] = 1.0
    return True


@njit(cache=True, nogil=True)
def _normalise(normal: Array) -> bool:
    norm = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    if not norm > 0.0 or normal[2] < 0.1 * norm:
        return False
    normal /= norm
    return True


@njit(cache=True, nogil=True)
def _brightness(px: _Pixel, v: int) -> float:
    """Sum over the channels of a view's samples; negative where there is none."""
    total, seen = 0.0, 0
    for ch in range(px.y.shape[0]):
        if math.isfinite(px.base[ch, v]):
            total += px.y[ch, v]
            seen += 1
    return max(total / seen, 0.0) if seen > 0 else -1.0


@njit(cache=True, nogil=True)
def _start_trimmed(px: _Pixel, normal: Array) -> bool:
    """Least-squares Lambert on the views whose residual is not among the largest, three rounds."""
    n_views = px.light.shape[0]
    use = np.zeros(n_views)
    r = np.zeros(n_views)
    for v in range(n_views):
        use[v] = 1.0 if _brightness(px, v) >= 0.0 else 0.0
    g = np.zeros(3)
    for _ in range(3):
        A = np.zeros((3, 3))
        b = np.zeros(3)
        for v in range(n_views):
            if use[v] > 0.0:
                y = _brightness(px, v)
                for i in range(3):
                    b[i] += px.light[v, i] * y
                    for j in range(3):
                        A[i, j] += px.light[v, i] * px.light[v, j]
        for i in range(3):
            A[i, i] += 1e-9 * (A[0, 0] + A[1, 1] + A[2, 2]) + 1e-30
        g[:] = np.linalg.solve(A, b)
        for v in range(n_views):
            fit = px.light[v, 0] * g[0] + px.light[v, 1] * g[1] + px.light[v, 2] * g[2]
            y = _brightness(px, v)
            r[v] = y - max(fit, 0.0) if y >= 0.0 else np.inf
        # Highlights lie above a Lambertian fit, shadows below: keep the middle of the residuals.
        middle = np.sort(r[np.isfinite(r)])
        high = middle[int(0.75 * (middle.size - 1))]
        low = middle[int(0.05 * (middle.size - 1))]
        for v in range(n_views):
            use[v] = 1.0 if math.isfinite(r[v]) and low <= r[v] <= high else 0.0
    normal[:] = g
    return _normalise(normal)


@njit(cache=True, nogil=True)
def _start_highlight(px: _Pixel, normal: Array) -> bool:
    """Mean half vector, weighed by the fourth power of brightness so that the peak decides."""
    normal[:] = 0.0
    peak = 0.0
    for v in range(px.half.shape[0]):
        peak = max(peak, _brightness(px, v))
    if peak <= 0.0:
        return False
    for v in range(px.half.shape[0]):
        w = (max(_brightness(px, v), 0.0) / peak) ** 4
        for i in range(3):
            normal[i] += w * px.half[v, i]
    return _normalise(normal)


@njit(cache=True, nogil=True)
def _lookup(c: float, n_nodes: int) -> tuple[int, float]:
    """Node below t = sqrt(1 - c) and the fraction beyond it."""
    x = math.sqrt(max(1.0 - c, 0.0)) * (n_nodes - 1)
    i = min(int(x), n_nodes - 2)
    return i, min(x - i, 1.0)


@njit(cache=True, nogil=True, fastmath=True)
def _fill_atoms(n: Array, px: _Pixel, table: Array32) -> None:
    """phi[v, k] = phi_k(c_v) s_v of every atom; zero where the surface faces away."""
    n_views, n_atoms = px.half.shape[0], px.phi.shape[1]
    for k in range(n_atoms):
        px.phi[n_views, k] = table[0, k]
    for v in range(n_views):
        c = n[0] * px.half[v, 0] + n[1] * px.half[v, 1] + n[2] * px.half[v, 2]
        s = n[0] * px.light[v, 0] + n[1] * px.light[v, 1] + n[2] * px.light[v, 2]
        c = min(max(c, 0.0), 1.0)
        s = max(s, 0.0)
        px.cosine_h[v] = c
        px.cosine_i[v] = s
        i, f = _lookup(c, table.shape[0])
        low = np.float32(s * (1.0 - f))
        high = np.float32(s * f)
        for k in range(n_atoms):
            px.phi[v, k] = low * table[i, k] + high * table[i + 1, k]


@njit(cache=True, nogil=True)
def _fit_channel(px: _Pixel, settings: Settings, work: Work, ch: int, grow: bool) -> None:
    """Fit one channel's coefficients to the atoms in `px.phi`, from the last ones, new atoms only if `grow`."""
    n_views = px.target.shape[0] - 1
    brightest, n_values = 0.0, 0
    for v in range(n_views):
        px.target[v] = px.y[ch, v]
        # A bound that the last model kept says nothing; one that it missed pulls like a value.
        kept = px.clipped[ch, v] and px.model[ch, v] > px.y[ch, v]
        px.pull[v] = 0.0 if kept else px.weight[ch, v]
        if px.pull[v] > 0.0:
            brightest = max(brightest, px.y[ch, v])
            n_values += 1
    px.pull[n_views] = 1.0 / (_PEAK * brightest) ** 2 if brightest > 0.0 else 0.0
    # With few views a curve of many atoms would pass through every sample, whatever the normal.
    most = min(max((n_values - 2) // 2, 1), MAX_ATOMS) if grow else px.n_active[ch]
    px.n_active[ch] = nnls(
        px.phi, px.pull, px.target, settings.tolerance, most, min(px.n_active[ch], most), px.active[ch], px.a[ch], work
    )
    columns = work[0]
    for v in range(n_views):
        fit = 0.0
        for j in range(px.n_active[ch]):
            fit += px.a[ch, j] * columns[j, v]
        px.model[ch, v] = fit


@njit(cache=True, nogil=True)
def _evaluate(px: _Pixel, settings: Settings, table: Array32, work: Work, normal: Array, kappa: float) -> float:
    """Cost at `normal`, coefficients refitted."""
    _fill_atoms(normal, px, table)
    for ch in range(px.y.shape[0]):
        _fit_channel(px, settings, work, ch, True)
    return _cost(px, settings, normal, kappa)


@njit(cache=True, nogil=True)
def _tangents(normal: Array, t1: Array, t2: Array) -> None:
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


@njit(cache=True, nogil=True)
def _normal_equations(
    px: _Pixel,
    settings: Settings,
    table: Array32,
    derivative: Array32,
    work: Work,
    normal: Array,
    t1: Array,
    t2: Array,
    H: Array,
    gradient: Array,
) -> None:
    """Write H = J^T W J and gradient J^T W r of the tangent parameters, J projected off the active atoms.

    The atoms are those of the last evaluation, which was at this normal or next to it.
    """
    columns, L = work[0], work[3]
    n_channels, n_views = px.y.shape
    H[:] = 0.0
    gradient[:] = 0.0
    B = np.empty((2, MAX_ATOMS))
    X = np.empty((2, MAX_ATOMS))
    for e in range(2):
        H[e, e] = 1.0 / NEAR_PLANAR**2
        gradient[e] = (t1[2] if e == 0 else t2[2]) / NEAR_PLANAR**2
    _fill_atoms(normal, px, table)
    for ch in range(n_channels):
        _fit_channel(px, settings, work, ch, False)
        m = px.n_active[ch]
        w = px.pull
        for v in range(n_views):
            i, f = _lookup(px.cosine_h[v], table.shape[0])
            value, slope = 0.0, 0.0
            for j in range(m):
                k = px.active[ch, j]
                value += px.a[ch, j] * ((1.0 - f) * table[i, k] + f * table[i + 1, k])
                slope += px.a[ch, j] * ((1.0 - f) * derivative[i, k] + f * derivative[i + 1, k])
            lit = 1.0 if px.cosine_i[v] > 0.0 else 0.0
            for e in range(2):
                t = t1 if e == 0 else t2
                dc = t[0] * px.half[v, 0] + t[1] * px.half[v, 1] + t[2] * px.half[v, 2]
                ds = t[0] * px.light[v, 0] + t[1] * px.light[v, 1] + t[2] * px.light[v, 2]
                px.J[e, v] = slope * px.cosine_i[v] * dc + lit * value * ds
        for e in range(2):
            for j in range(m):
                B[e, j] = 0.0
                for v in range(n_views):
                    B[e, j] += w[v] * columns[j, v] * px.J[e, v]
            solve_factored(L, B[e], m, X[e])
        for e in range(2):
            for v in range(n_views):
                gradient[e] += w[v] * px.J[e, v] * (px.y[ch, v] - px.model[ch, v])
            for d in range(2):
                for v in range(n_views):
                    H[e, d] += w[v] * px.J[e, v] * px.J[d, v]
                for j in range(m):
                    H[e, d] -= B[e, j] * X[d, j]


@njit(cache=True, nogil=True)
def _refine(
    px: _Pixel,
    settings: Settings,
    table: Array32,
    derivative: Array32,
    work: Work,
    normal: Array,
    H: Array,
    kappa: float,
    n_steps: int,
) -> tuple[float, bool]:
    """Levenberg-Marquardt on the tangent parameters; returns the cost and whether it converged."""
    t1, t2, gradient, trial = np.empty(3), np.empty(3), np.empty(2), np.empty(3)
    saved_n, saved_active, saved_a = px.n_active.copy(), px.active.copy(), px.a.copy()
    cost = _evaluate(px, settings, table, work, normal, kappa)
    damping = 1e-3
    converged = False
    for _ in range(n_steps):
        _tangents(normal, t1, t2)
        _normal_equations(px, settings, table, derivative, work, normal, t1, t2, H, gradient)
        saved_n[:], saved_active[:], saved_a[:] = px.n_active, px.active, px.a
        accepted, shortest = False, False
        for _ in range(4):
            h00, h11 = H[0, 0] * (1.0 + damping), H[1, 1] * (1.0 + damping)
            determinant = h00 * h11 - H[0, 1] ** 2
            if not determinant > 0.0:
                damping = max(10.0 * damping, 1e-3)
                continue
            d1 = (h11 * gradient[0] - H[0, 1] * gradient[1]) / determinant
            d2 = (h00 * gradient[1] - H[0, 1] * gradient[0]) / determinant
            length = math.sqrt(d1 * d1 + d2 * d2)
            if length > _LONGEST_STEP:
                d1, d2 = d1 * _LONGEST_STEP / length, d2 * _LONGEST_STEP / length
            shortest = length < _CONVERGED_STEP
            for i in range(3):
                trial[i] = normal[i] + d1 * t1[i] + d2 * t2[i]
            if _normalise(trial):
                new = _evaluate(px, settings, table, work, trial, kappa)
                if new < cost:
                    accepted = True
                    shortest = shortest or cost - new < _SETTLED
                    cost = new
                    normal[:] = trial
                    damping = max(0.2 * damping, 1e-7)
                    break
            px.n_active[:], px.active[:], px.a[:] = saved_n, saved_active, saved_a
            damping *= 8.0
            if shortest:
                break
        if shortest or not accepted:
            converged = True
            break
    _tangents(normal, t1, t2)
    _normal_equations(px, settings, table, derivative, work, normal, t1, t2, H, gradient)
    return cost, converged


@njit(cache=True, nogil=True)
def _write_unsolved(p: int, flags: int, out: Solution) -> None:
    out.normal[p] = np.nan
    out.covariance[p] = np.nan
    out.reduced_chi2[p] = np.nan
    out.atom[p] = -1
    out.coefficient[p] = 0.0
    out.flags[p] = flags
    out.n_dot_h_range[p] = np.nan


@njit(cache=True, nogil=True)
def _write(p: int, flags: int, px: _Pixel, normal: Array, H: Array, out: Solution) -> None:
    """Write normal, covariance H^-1 (widened where the fit is worse than the noise) and coefficients."""
    n_channels, n_views = px.y.shape
    _chi2_of_views(px)
    total, robust_total, n_samples, n_unknowns = 0.0, 0.0, 0, 2
    low, high = 1.0, 0.0
    for v in range(n_views):
        seen = False
        for ch in range(n_channels):
            kept = px.clipped[ch, v] and px.model[ch, v] > px.y[ch, v]
            if px.weight[ch, v] > 0.0 and not kept:
                r = px.y[ch, v] - px.model[ch, v]
                total += r * r / px.sigma2[ch, v]
                robust_total += r * r * px.weight[ch, v]
                n_samples += 1
                seen = True
        if seen and px.cosine_i[v] > 0.0:
            low = min(low, px.cosine_h[v])
            high = max(high, px.cosine_h[v])
    for ch in range(n_channels):
        n_unknowns += px.n_active[ch]
        for j in range(MAX_ATOMS):
            used = j < px.n_active[ch]
            out.atom[p, ch, j] = px.active[ch, j] if used else -1
            out.coefficient[p, ch, j] = px.a[ch, j] if used else 0.0
    dof = max(n_samples - n_unknowns, 1)
    determinant = H[0, 0] * H[1, 1] - H[0, 1] ** 2
    out.reduced_chi2[p] = total / dof
    if total / dof > _POOR_FIT:
        flags |= POOR_FIT
    if not determinant > 0.0:
        # No direction of the tangent plane changes the fit: the normal is a guess, and says so.
        _write_unsolved(p, flags | BLACK, out)
        return
    widening = max(1.0, robust_total / dof) / determinant
    out.covariance[p, 0] = H[1, 1] * widening
    out.covariance[p, 1] = -H[0, 1] * widening
    out.covariance[p, 2] = H[0, 0] * widening
    out.normal[p] = normal
    out.flags[p] = flags
    out.n_dot_h_range[p, 0] = low
    out.n_dot_h_range[p, 1] = high
