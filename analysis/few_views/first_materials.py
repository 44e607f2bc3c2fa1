"""Which pixels may be of one material, before anything is solved: by the colour and level of their darker views."""

from __future__ import annotations

import warnings

import numpy as np
from numpy.typing import NDArray
from scipy.cluster.vq import kmeans2
from scipy.ndimage import gaussian_filter, gaussian_gradient_magnitude

from analysis.few_views.kernels import Seen

Array = NDArray[np.float64]

Labels = NDArray[np.int64]

N_MATERIALS = 6

INTERIOR_PERCENT = 60.0
"""Pixels whose colour changes less than that of so many percent are interiors. Borders mix materials and would be
groups of their own: from all pixels the predictions of a real card are a third worse."""

_BLUR_PX = 0.7

_LEVEL_SHARE = 0.5  # of the log level beside the log ratios of the channels

_N_RUNS, _N_FITTED, _N_ITERATIONS = 3, 8000, 40


def by_colour(seen: Seen, shape: tuple[int, int], dark: float) -> Labels:
    """Group pixels by the level and the colour of the darker half of their views, shape (P,).

    A highlight is in the brighter half, so that a pixel's normal does not decide.
    """
    radiance = np.where(seen.valid > 0, seen.radiance, np.nan).astype(np.float64)
    n_dark = max(2, len(radiance) // 2)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a pixel that no view sees
        level = np.nanmean(np.sort(radiance, axis=0)[:n_dark], axis=0)
    level = np.log(np.nan_to_num(level) + 0.4 * dark)
    ratios = np.diff(level, axis=1)
    feature = np.concatenate([_LEVEL_SHARE * level.mean(axis=1, keepdims=True), ratios], axis=1)
    picture = gaussian_filter(feature.reshape(*shape, -1), (_BLUR_PX, _BLUR_PX, 0.0))
    change = sum(gaussian_gradient_magnitude(layer, 1.0) for layer in np.moveaxis(picture, -1, 0))
    interior = (change <= np.percentile(change, INTERIOR_PERCENT)).ravel()
    return _groups(picture.reshape(-1, feature.shape[1]), interior, N_MATERIALS)


def _groups(feature: Array, learnt: NDArray[np.bool_], n: int) -> Labels:
    """Return the nearest centre of k-means over some rows, for all; the best of a few runs."""
    rows = feature[learnt]
    rows = rows[:: max(len(rows) // _N_FITTED, 1)]
    n = min(n, len(np.unique(rows.round(6), axis=0)))
    best, least = rows[:1], np.inf
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # a run that leaves a group empty is a poor run, no more
        for seed in range(_N_RUNS):
            centre, nearest = kmeans2(rows, n, minit="++", iter=_N_ITERATIONS, seed=seed)
            spread = float(np.mean((rows - centre[nearest]) ** 2))
            if spread < least:
                best, least = centre, spread
    return np.asarray(np.sum((feature[:, None] - best[None]) ** 2, axis=-1).argmin(axis=1), np.int64)
