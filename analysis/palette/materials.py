"""Groups of pixels of like reflectance, from their fitted curves."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2

from analysis.pixels.fits import PixelFits
from analysis.reflectance.models import Cosines
from analysis.reflectance.palette import PALETTE, material_name

Array = NDArray[np.float64]

MAX_GROUPS = 12

WORTHWHILE = 0.7
"""One group more is kept while it leaves less than this share of the spread of the curves within groups."""

_N_ANGLES, _N_COMPONENTS, _N_FITTED, _N_RUNS, _SEED = 8, 6, 3000, 4, 0


def group_materials(fits: PixelFits) -> NDArray[np.int16]:
    """Group pixels by the logarithm of their curves over the half angles that most of them saw.

    k-means on principal components; the number of groups is the largest whose last one was worth it
    (`WORTHWHILE`). Groups are numbered by size, the largest 0; unsolved pixels are -1. A description of
    the scene, not a model of it: curves are not shared within a group. Where a palette was used, groups are
    its materials instead, by the largest share of each pixel; pixels that use none of them are one more group.

    Returns
    -------
    ndarray of int16, shape (P,)
    """
    solved = np.flatnonzero(np.isfinite(fits.normals[:, 0]))
    group = np.full(len(fits.normals), -1, np.int16)
    if len(solved) == 0:
        return group
    if fits.dictionary.name == PALETTE:
        leading = leading_material(fits)[solved]
        nearest = np.unique(leading, return_inverse=True)[1]
        group[solved] = _ranked(nearest, nearest.max() + 1)
        return group
    features = curve_features(fits, solved)
    sample = np.random.default_rng(_SEED).choice(len(features), min(len(features), _N_FITTED), replace=False)
    centres = features[sample].mean(axis=0, keepdims=True)
    best, spread = centres, _distance2(features[sample], centres).min(axis=1).mean()
    # A sample all of one curve, or of a few, has no more groups than curves.
    n_distinct = len(np.unique(features[sample].round(6), axis=0))
    for k in range(2, min(MAX_GROUPS, n_distinct) + 1):
        more, less_spread = _k_means(features[sample], k)
        # Two groups more may be worth it where one is not, so all numbers are tried.
        if less_spread < WORTHWHILE * spread:
            best = more
        spread = less_spread
    centres = best
    nearest = _distance2(features, centres).argmin(axis=1)
    group[solved] = _ranked(nearest, len(centres))
    return group


def _ranked(group: NDArray[np.int64], n: int) -> NDArray[np.int64]:
    """Return the groups numbered by size, the largest 0."""
    order = np.argsort(-np.bincount(group, minlength=n), kind="stable")
    return np.asarray(np.argsort(order)[group])


def materials_used(fits: PixelFits) -> NDArray[np.int64]:
    """Return the palette's materials in each pixel, shape (P, MAX_ATOMS); -1 = none of them."""
    n_channels = fits.atom.shape[1]
    atoms = fits.dictionary.atoms
    n_own = next((i for i, atom in enumerate(atoms) if atom.name != material_name(i // n_channels)), len(atoms))
    of_palette = (fits.atom[:, 0] >= 0) & (fits.atom[:, 0] < n_own)
    return np.where(of_palette, fits.atom[:, 0] // n_channels, -1).astype(np.int64)


def leading_material(fits: PixelFits) -> NDArray[np.int64]:
    """Return the palette's material with the largest share in each pixel, shape (P,); -1 = none of them."""
    material = materials_used(fits)
    slot = np.where(material >= 0, fits.coefficient[:, 0], -1.0).argmax(axis=1)
    return np.asarray(np.take_along_axis(material, slot[:, None], axis=1)[:, 0])


def cluster(features: Array, k: int) -> NDArray[np.int64]:
    """Return for each row of `features` which of `k` groups it belongs to (k-means, the best of a few runs)."""
    return np.asarray(_distance2(features, _k_means(features, k)[0]).argmin(axis=1))


def _k_means(features: Array, k: int) -> tuple[Array, float]:
    """Return the best of a few runs: centres and mean squared distance to the nearest."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a run that leaves a group empty is a poor run, no more
        runs = [kmeans2(features, k, minit="++", seed=seed, iter=30)[0] for seed in range(_N_RUNS)]
    spreads = [float(_distance2(features, centres).min(axis=1).mean()) for centres in runs]
    best = int(np.argmin(spreads))
    return np.asarray(runs[best]), spreads[best]


def curve_features(fits: PixelFits, solved: NDArray[np.int64]) -> Array:
    """Return what tells the curves of these pixels apart, shape (len(solved), at most `_N_COMPONENTS`)."""
    near, far = np.median(fits.theta_h_range[solved], axis=0)
    angles = np.broadcast_to(np.linspace(near, far, _N_ANGLES), (len(solved), _N_ANGLES))
    curves = fits.select(solved).brdf(Cosines.on_slice(angles)).reshape(len(solved), -1)
    # The logarithm makes a dark and a bright paint of one kind as far apart as their ratio.
    logs = np.log(np.maximum(curves, 1e-4 * np.median(curves) + 1e-12))
    logs -= logs.mean(axis=0)
    components = np.linalg.svd(logs[:: max(len(logs) // _N_FITTED, 1)], full_matrices=False)[2][:_N_COMPONENTS]
    return np.asarray(logs @ components.T)


def _distance2(features: Array, centres: Array) -> Array:
    return np.asarray(np.sum((features[:, None, :] - centres[None]) ** 2, axis=-1))
