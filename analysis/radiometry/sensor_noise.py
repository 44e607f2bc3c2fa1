"""Estimates gain and read noise of a sensor from a bracket, by photon transfer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.radiometry.exposure_ratios import estimate_exposure_ratios
from analysis.radiometry.hdr import Sensor
from analysis.robust import mad_sigma

Array = NDArray[np.float64]

FULL_WELL = 15_000.0
"""Electrons at full range that are assumed where pictures cannot tell: a small pixel's."""

READ_NOISE = 3.0
"""Electrons that are assumed where pictures cannot tell."""

_N_BINS, _MIN_IN_BIN = 16, 50


def assumed_sensor(saturation_level: float, black_level: float, step: float) -> Sensor:
    """Return a usual sensor of that range."""
    gain = FULL_WELL / (saturation_level - black_level)
    return Sensor(saturation_level, gain, READ_NOISE, step)


def estimate_noise_model(
    samples: Array, trusted: Array, exposure_times: Array, assumed: Sensor
) -> tuple[float, float] | None:
    """Estimate gain and read noise by photon transfer between neighbouring exposures.

    With y = r x, the difference y - r x has the variance (1 + r) r x / g + (1 + r^2) v: a line over x.

    Parameters
    ----------
    samples : ndarray, shape (n_exposures, n_pixels)
        Counts above black of one pose.
    trusted : ndarray, shape (n_pixels,)
        Counts above black up to which each pixel is believed.
    exposure_times : ndarray, shape (n_exposures,)
        Seconds, ascending.
    assumed : Sensor
        To start from.

    Returns
    -------
    tuple of float or None
        Conversion gain, electrons per count, and read noise, electrons; None if the pictures cannot tell.
    """
    ratios = estimate_exposure_ratios(samples, trusted, exposure_times, assumed)
    parts = [_binned(x, y, trusted, r) for x, y, r in zip(samples[:-1], samples[1:], ratios.ratio, strict=True)]
    rows = np.concatenate([p for p in parts if p is not None] or [np.empty((0, 3))])
    if len(rows) < 4:
        return None
    # Relative errors of the variances are alike: divide each line by its variance.
    A, y = rows[:, :2] / rows[:, 2:], np.ones(len(rows))
    inverse_gain, read_variance = np.linalg.lstsq(A, y, rcond=None)[0]
    if not inverse_gain > 0.0:
        return None
    gain = 1.0 / float(inverse_gain)
    return gain, gain * float(np.sqrt(max(read_variance - assumed.step**2 / 12.0, 0.0)))


def _binned(x: Array, y: Array, trusted: Array, r: float) -> Array | None:
    """Return rows ((1 + r) r x, 1 + r^2, variance of y - r x) for bins of brightness."""
    light = (x + y) / (1.0 + r)
    use = np.flatnonzero((light > 0.0) & (r * light < 0.9 * trusted)) if np.isfinite(r) else np.empty(0, np.int64)
    if len(use) < 4 * _MIN_IN_BIN:
        return None
    order = use[np.argsort(light[use], kind="stable")]
    bins = np.array_split(order, min(_N_BINS, len(order) // _MIN_IN_BIN))
    spread = [mad_sigma(d - np.median(d)) for d in ((y - r * x)[b] for b in bins)]
    rows = np.array([[(1.0 + r) * r * light[b].mean(), 1.0 + r * r, s * s] for b, s in zip(bins, spread, strict=True)])
    return rows[rows[:, 2] > 0.0]
