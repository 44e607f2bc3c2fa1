"""Which material each pixel is of, or which two at a border, once there are curves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, maximum_filter

from analysis.few_views.kernels import copied
from analysis.few_views.state import State

Array = NDArray[np.float64]

Labels = NDArray[np.int64]

SHARES = (0.2, 0.4, 0.6, 0.8)
"""Of the second material in a mixture."""

BORDER_SIGMA, BORDER_SPREAD = 0.15, 0.03
"""Log radiance and slope: a border pixel is not let off by the large sigma of its own material."""

_WINDOW_PX = 1.0  # over which the loss decides: a label that only one pixel's noise wants is none

_REACH_PX = 2  # from a material, within which a pixel may be part of it

_MIXING_LOSS = 1.0  # a mixture must fit better by so much than one material

_FEWEST = 20  # pixels at the border of two materials

_MOST_SIGMA = 0.25  # of a material once its borders are told apart


def relabel(state: State) -> None:
    """Let each pixel try every material; the loss over a small window decides."""
    before = copied(state.field)
    tried, losses = [], []
    n_samples = state.seen.valid.sum(axis=(0, 2)) * state.channel_weight
    for k in range(state.n_materials):
        state.field.material[:] = k
        state.field.slope[:], state.field.albedo[:] = before.slope, before.albedo
        state.fit(3)
        tried.append(copied(state.field))
        loss = state.field.loss + n_samples * np.log(state.sigma[k])
        losses.append(gaussian_filter(loss.reshape(state.shape), _WINDOW_PX).ravel())
    best = np.argmin(losses, axis=0)
    for k, fields in enumerate(tried):
        own = best == k
        for to, of in zip(state.field, fields, strict=True):
            to[own] = of[own]
    for i in range(2):
        state.field[3 + i][:] = before[3 + i]


def mix_borders(state: State) -> None:
    """Let pixels within reach of two materials be a mixture of them, where that fits better."""
    K, field = state.n_materials, state.field
    labels = field.material.reshape(state.shape)
    near = np.stack([maximum_filter(labels == k, size=2 * _REACH_PX + 1).ravel() for k in range(K)])
    border = near.sum(axis=0) > 1
    pairs = [(a, b) for a in range(K) for b in range(a + 1, K) if (near[a] & near[b]).sum() > _FEWEST]
    if not pairs:
        return
    state.mixtures = [(a, b, share) for a, b in pairs for share in SHARES]
    n = len(state.mixtures)
    spread, precision = np.append(state.spread, np.full(n, BORDER_SPREAD)), field.precision.copy()
    # All candidates are compared at one sigma.
    sigma, state.sigma = state.sigma, np.full(K + n, BORDER_SIGMA)
    field.precision[:] = 1.0 / BORDER_SPREAD**2
    before = copied(field)
    best = copied(field)
    best.loss[border] = np.inf
    for label in range(K + n):
        if label < K:
            pixels, more = np.flatnonzero(border & near[label]), 0.0
        else:
            a, b, _ = state.mixtures[label - K]
            pixels, more = np.flatnonzero(border & near[a] & near[b]), _MIXING_LOSS
        field.material[pixels] = label
        field.slope[pixels], field.albedo[pixels] = before.slope[pixels], 0.0
        state.fit(4, pixels)
        field.loss[pixels] += more
        better = pixels[field.loss[pixels] < best.loss[pixels]]
        for to, of in zip(best, field, strict=True):
            to[better] = of[better]
    for to, of in zip(field, best, strict=True):
        to[:] = of
    state.sigma = np.concatenate([np.minimum(sigma, _MOST_SIGMA), np.full(n, BORDER_SIGMA)])
    state.spread = spread
    field.precision[:] = np.where(field.material < K, precision, 1.0 / BORDER_SPREAD**2)
