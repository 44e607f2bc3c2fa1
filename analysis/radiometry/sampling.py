"""Samples a few pixels of a few poses, for estimates that do not need all of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.radiometry.mosaic import cell_shape

Array = NDArray[np.float64]

N_PIXELS = 20_000


@dataclass(frozen=True, slots=True)
class FrameSamples:
    """Some pixels of one pose.

    Attributes
    ----------
    counts : ndarray, shape (n_exposures, n_pixels)
        Linear, above black; exposures from short to long.
    trusted : ndarray, shape (n_pixels,)
        Counts above black up to which each pixel is believed.
    exposure_times : ndarray, shape (n_exposures,)
        Seconds, as reported.
    """

    counts: Array
    trusted: Array
    exposure_times: Array

    @property
    def all_clipped(self) -> NDArray[np.bool_]:
        """Which pixels are clipped even in the shortest exposure, shape (n_pixels,)."""
        return np.asarray(self.counts[0] >= self.trusted)


def sample_frames(frames: NDArray[Any], exposure_times: Array, black: NDArray[Any], trusted: Array) -> FrameSamples:
    """Take pixels from all over the frames of one pose.

    Parameters
    ----------
    frames : ndarray, shape (n_exposures, height, width) or (n_exposures, height, width, 3)
        Linear counts.
    exposure_times : ndarray, shape (n_exposures,)
        Seconds.
    black : ndarray
        Darks, shape of `frames`; or of each place of the cell.
    trusted : ndarray
        Counts up to which a pixel is believed, one number or of each place of the cell.
    """
    rng = np.random.default_rng(0)
    height, width, *channels = frames.shape[1:]
    rows, columns = rng.integers(height, size=N_PIXELS), rng.integers(width, size=N_PIXELS)
    picked: tuple[Any, ...] = (rows, columns)
    place: tuple[Any, ...] = (rows % 2, columns % 2)
    if channels:
        channel = rng.integers(channels[0], size=N_PIXELS)
        picked, place = (rows, columns, channel), (channel,)
    per_pixel = black[(slice(None), *picked)] if black.shape == frames.shape else black[place]
    limit = np.broadcast_to(trusted, cell_shape(frames))[place]
    order = np.argsort(exposure_times, kind="stable")
    counts = (frames[(slice(None), *picked)].astype(np.float64) - per_pixel)[order]
    level = per_pixel if per_pixel.ndim == 1 else per_pixel.mean(axis=0)
    return FrameSamples(counts, np.asarray(limit - level, np.float64), exposure_times[order])


def spread_poses(pose_complete: NDArray[np.bool_], n: int) -> NDArray[np.int64]:
    """Return up to `n` complete poses, from the first to the last."""
    complete = np.flatnonzero(pose_complete)
    picked = np.unique(np.linspace(0, len(complete) - 1, min(n, len(complete))).round().astype(int))
    return np.asarray(complete[picked])


def cell_medians(dark: NDArray[np.float32]) -> Array:
    """Return the median of darks (n_exposures, height, width[, 3]) at each place of the cell: (2, 2), or (3,)."""
    if dark.ndim == 4:
        return np.asarray(np.median(dark.reshape(-1, dark.shape[-1]), axis=0), np.float64)
    return np.array([[float(np.median(dark[:, row::2, column::2])) for column in (0, 1)] for row in (0, 1)])
