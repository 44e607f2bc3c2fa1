"""A solution of few views as fits of pixels and materials, as all that follows takes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.few_views.curves import N_TABLE, curve_sigma
from analysis.few_views.curves import NODES as KNOTS
from analysis.few_views.method import FewViews
from analysis.pixels.fits import PixelFits
from analysis.pixels.nnls import MAX_ATOMS
from analysis.pixels.samples import CLIPPED, MIN_VIEWS, TOO_FEW_VIEWS
from analysis.reflectance.palette import NODES, Palette
from analysis.reflectance.palette_completion import MaterialBrdfs, complete_palette

Array = NDArray[np.float64]

_SEEN_PERCENT = (1.0, 95.0)  # of a material's pixels, that saw smaller and larger half angles


def palette_of(few: FewViews) -> Palette:
    """Return the pure materials' curves."""
    t = np.linspace(0.0, 1.0, N_TABLE)
    table = few.state.curves.table()
    return Palette(np.exp([[np.interp(NODES, t, curve) for curve in channels] for channels in table]))


def fits_of(few: FewViews) -> PixelFits:
    """Return the fits of all pixels.

    A coefficient is exp(a + sigma^2 / 2): what a material's pixels scatter about their model in logarithms has that
    mean.
    """
    state = few.state
    field, K, C = state.field, state.n_materials, state.n_channels
    n_pixels = len(field.loss)
    atom = np.full((n_pixels, C, MAX_ATOMS), -1, np.int16)
    coefficient = np.zeros((n_pixels, C, MAX_ATOMS))
    level = np.exp(field.albedo + 0.5 * state.sigma[field.material][:, None] ** 2)
    parts = [(k, k, 0.0) for k in range(K)] + state.mixtures
    first, second, share = (np.array(column)[field.material] for column in zip(*parts, strict=True))
    channels = np.arange(C)
    atom[:, :, 0] = first[:, None] * C + channels
    coefficient[:, :, 0] = level * (1.0 - share)[:, None]
    mixed = share > 0.0
    atom[mixed, :, 1] = second[mixed, None] * C + channels
    coefficient[mixed, :, 1] = level[mixed] * share[mixed, None]
    valid = np.asarray(state.seen.valid.any(axis=2))
    n_views = valid.sum(axis=0)
    solved = (n_views >= MIN_VIEWS) & np.isfinite(field.covariance[:, 0])
    clipped = (state.seen.clipped > 0).any(axis=(0, 2))
    flags = np.where(clipped, CLIPPED, 0) | np.where(solved, 0, TOO_FEW_VIEWS)
    normals = state.normals()
    return PixelFits(
        normals=np.where(solved[:, None], normals, np.nan),
        covariance=np.where(solved[:, None], _tangent_covariance(field.covariance, normals), np.nan),
        reduced_chi2=np.where(solved, _reduced_chi2(few), np.nan),
        loss=np.where(solved, field.loss / np.maximum(n_views, 1), np.nan),
        atom=np.where(solved[:, None, None], atom, -1).astype(np.int16),
        coefficient=np.where(solved[:, None, None], coefficient, 0.0),
        flags=flags.astype(np.uint8),
        theta_h_range=np.where(solved[:, None], _theta_h_range(state.seen.half, valid, normals), np.nan),
        dictionary=palette_of(few).dictionary,
    )


def materials_of(few: FewViews, fits: PixelFits) -> MaterialBrdfs:
    """Return the materials over all angles, with their band."""
    state = few.state
    assert state.system is not None
    sigma = curve_sigma(state.system)
    relative = np.array([[np.interp(NODES, KNOTS, s) for s in channels] for channels in sigma])
    leading, ranges = state.leading(), fits.theta_h_range
    everywhere = np.nanmedian(ranges, axis=0)
    seen = np.stack([_seen(ranges[leading == k], everywhere) for k in range(state.n_materials)])
    return complete_palette(palette_of(few), relative, seen)


def _seen(ranges: Array, otherwise: Array) -> Array:
    ranges = ranges[np.isfinite(ranges[:, 0])]
    if len(ranges) == 0:
        return otherwise
    low, high = (np.percentile(ranges[:, i], percent) for i, percent in enumerate(_SEEN_PERCENT))
    return np.array([low, min(high, np.deg2rad(85.0))])


def _tangent_covariance(covariance: Array, normals: Array) -> Array:
    """Return the covariance of two tangent parameters from that of the slopes.

    n = (-p, -q, 1) k with k = (1 + p^2 + q^2)^(-1/2): along the steepest slope a normal turns by k^2, across by k.
    """
    n_z = np.maximum(normals[:, 2], 1e-3)
    steep = np.linalg.norm(normals[:, :2], axis=1)
    flat = steep < 1e-9
    u = np.where(flat[:, None], [1.0, 0.0], normals[:, :2] / np.where(flat, 1.0, steep)[:, None])
    pp, pq, qq = covariance.T
    along = (u[:, 0] ** 2 * pp + 2.0 * u[:, 0] * u[:, 1] * pq + u[:, 1] ** 2 * qq) * n_z**4
    across = (u[:, 1] ** 2 * pp - 2.0 * u[:, 0] * u[:, 1] * pq + u[:, 0] ** 2 * qq) * n_z**2
    both = (u[:, 0] * u[:, 1] * (qq - pp) + (u[:, 0] ** 2 - u[:, 1] ** 2) * pq) * n_z**3
    return np.stack([along, both, across], axis=1)


def _reduced_chi2(few: FewViews) -> Array:
    state = few.state
    seen, field = state.seen, state.field
    model = state.predict(seen, np.arange(len(field.loss)))
    r = np.log((seen.radiance + state.dark) / (model + state.dark)) / state.sigma[field.material][:, None]
    counted = (seen.valid > 0) & ~((seen.clipped > 0) & (r < 0.0))
    n = counted.sum(axis=(0, 2)) * state.channel_weight
    total = np.where(counted, r * r, 0.0).sum(axis=(0, 2)) * state.channel_weight
    return np.asarray(total / np.maximum(n - field.n_used, 1.0))


def _theta_h_range(half: NDArray[np.float32], valid: NDArray[np.bool_], normals: Array) -> Array:
    cosine = np.einsum("vpi,pi->vp", half, normals)
    low = np.where(valid, cosine, np.inf).min(axis=0)
    high = np.where(valid, cosine, -np.inf).max(axis=0)
    return np.asarray(np.arccos(np.clip(np.stack([high, low], axis=1), -1.0, 1.0)))
