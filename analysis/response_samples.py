"""Which places of a bracket the response curve is taken from: small even blocks of all brightnesses."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.response import N_LEVELS
from instrument.validation import Problem, raise_if_any

Array = NDArray[np.float64]

N_SAMPLES = 300
"""A channel: more make the curve no better than the camera repeats itself."""

LOWEST, HIGHEST = 3, 250
"""Counts of a block's darkest and brightest pixel between which it is used: rounding and clipping rule beyond."""

_BLOCKS_ACROSS = 75  # the shorter side
_EVEN_SHARE = 0.5  # of all blocks, the most even ones
_LEAST_USABLE = 0.001  # share of a picture's blocks
_LEAST_STOPS = 2.0
_LEAST_EXPOSURES = 3


@dataclass(frozen=True, slots=True)
class BracketSamples:
    """Mean counts of even blocks.

    Attributes
    ----------
    counts : ndarray, shape (n_channels, n_samples, n_exposures)
    valid : ndarray of bool, same shape
        Not too dark in any pixel of the block, nor clipped in any channel.
    exposure_times : ndarray, shape (n_exposures,)
        Seconds, as reported.
    """

    counts: Array
    valid: NDArray[np.bool_]
    exposure_times: Array


def bracket_samples(pictures: NDArray[np.uint8], exposure_times: Array) -> BracketSamples:
    """Choose places of a bracket of a scene that did not move.

    Parameters
    ----------
    pictures : ndarray of uint8, shape (n_exposures, height, width, n_channels)
    exposure_times : ndarray, shape (n_exposures,)
        Seconds.

    Raises
    ------
    InvalidInputError
        If such a bracket cannot tell the curve, with the reasons.
    """
    raise_if_any(_TITLE, _shape_problems(pictures, exposure_times))
    block = max(min(pictures.shape[1:3]) // _BLOCKS_ACROSS, 1)
    tiles = _tiles(pictures, block)
    mean, low, high = tiles.mean(axis=-1, dtype=np.float64), tiles.min(axis=-1), tiles.max(axis=-1)
    # The camera mixed the channels after the sensor had clipped: one that clips takes the others with it.
    valid = (low >= LOWEST) & (high <= HIGHEST).all(axis=-1, keepdims=True)
    raise_if_any(_TITLE, _range_problems(valid, exposure_times))
    uneven = (high.astype(np.int64) - low).max(axis=(0, -1))
    even = np.flatnonzero(uneven <= np.quantile(uneven, _EVEN_SHARE))
    chosen = [_spread(mean[:, even, c], valid[:, even, c]) for c in range(mean.shape[-1])]
    n = min(len(c) for c in chosen)
    raise_if_any(_TITLE, _sample_problems(n))
    picked = [even[c[np.linspace(0, len(c) - 1, n).round().astype(int)]] for c in chosen]
    counts = np.stack([mean[:, p, c].T for c, p in enumerate(picked)])
    return BracketSamples(counts, np.stack([valid[:, p, c].T for c, p in enumerate(picked)]), exposure_times)


_TITLE = "The response curve cannot be found from this bracket."


def _shape_problems(pictures: NDArray[np.uint8], exposure_times: Array) -> list[Problem]:
    if pictures.dtype != np.uint8 or pictures.ndim != 4:
        what = f"are {pictures.dtype} of shape {pictures.shape}; allowed is 8 bit, (exposures, height, width, channels)"
        return [Problem("pictures", what)]
    if exposure_times.shape != pictures.shape[:1] or not np.all(exposure_times > 0.0):
        return [Problem("exposure times", f"are {exposure_times} s; there must be a positive one for each picture")]
    return []


def _range_problems(valid: NDArray[np.bool_], exposure_times: Array) -> list[Problem]:
    """Say why a bracket with such valid blocks (n_exposures, n_blocks, n_channels) cannot tell the curve."""
    usable = valid.mean(axis=1).min(axis=-1) > _LEAST_USABLE
    if not usable.any():
        return [Problem("pictures", "are clipped or black everywhere; take some between")]
    problems = []
    if usable.sum() < _LEAST_EXPOSURES:
        what = f"{usable.sum()} of {len(usable)} are neither clipped nor black; {_LEAST_EXPOSURES} at least are needed"
        problems.append(Problem("pictures", what))
    stops = float(np.log2(exposure_times[usable].max() / exposure_times[usable].min()))
    if stops < _LEAST_STOPS:
        what = f"of usable pictures span {stops:.1f} stops; {_LEAST_STOPS:g} at least are needed, 6 are good"
        problems.append(Problem("exposure times", what))
    return problems


def _sample_problems(n_samples: int) -> list[Problem]:
    if n_samples >= 20:
        return []
    what = f"have {n_samples} even places that two exposures show; 20 at least are needed: take a scene of more"
    return [Problem("pictures", what)]


def _tiles(pictures: NDArray[np.uint8], block: int) -> NDArray[np.uint8]:
    """Return square blocks, shape (n_exposures, n_blocks, n_channels, block * block)."""
    n, height, width, channels = pictures.shape
    rows, columns = height // block, width // block
    cut = pictures[:, : rows * block, : columns * block].reshape(n, rows, block, columns, block, channels)
    return cut.transpose(0, 1, 3, 5, 2, 4).reshape(n, rows * columns, channels, block * block)


def _spread(mean: Array, valid: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Return up to `N_SAMPLES` of the blocks (n_exposures, n_blocks) that two exposures show, from dark to bright."""
    of_use = np.flatnonzero(valid.sum(axis=0) >= 2)
    total = np.clip(mean[:, of_use], 0, N_LEVELS - 1).sum(axis=0)
    # Evenly in brightness, not in rank: most of a picture may be of one brightness.
    order = np.argsort(total, kind="stable")
    wanted = np.linspace(total.min(initial=0.0), total.max(initial=0.0), N_SAMPLES)
    rank = np.unique(np.searchsorted(total[order], wanted).clip(0, max(len(order) - 1, 0)))
    return np.asarray(of_use[order[rank]])
