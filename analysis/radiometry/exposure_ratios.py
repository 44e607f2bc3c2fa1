"""Ratios of exposure times from the pictures themselves, to compare with what the camera reports.

Pixels that are well exposed in two neighbouring exposures, x and y counts above black, obey

    y = r x + c ,

with the ratio r of the times and c = b (1 - r), if b counts too few were subtracted as black. Both have noise,
so that plain regression would make r too small: the normal equations are taken against the pixel's best
estimate from both exposures, whose noise is independent of that of y - r x. Pixels are chosen by that estimate
too, since a choice by x or y alone prefers noise of one sign.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np
from numpy.typing import NDArray

from analysis.radiometry.hdr import Sensor
from analysis.robust import mad_sigma, tukey_weights

Array = NDArray[np.float64]

WARN_DEVIATION = 0.01
"""Relative difference from the nominal ratio above which a report warns."""

_MIN_PIXELS = 100

_SYSTEMATIC = 0.001  # of a ratio: what the sensor's departure from linearity may feign

_BLACK_SIGMA = 2.0  # counts, prior; of sigmas of a dark pixel where there are no counts

_DARKEST = 10.0  # sigmas of read noise, in the shorter exposure

_BRIGHTEST = 0.9  # of what the longer one can be trusted with

_EXACT = 1e-100  # standard deviation of a constant that is known, in counts; its square is still a number
_TUKEY = 4.685

_ROUNDS = 6


@dataclass(frozen=True, slots=True)
class ExposureRatios:
    """Ratios of each exposure time to the next shorter one, from short to long.

    Attributes
    ----------
    nominal : ndarray, shape (n_exposures - 1,)
        As the camera reports them.
    ratio, sigma : ndarray, shape (n_exposures - 1,)
        As the pictures have them; NaN and infinite where no pixels tell.
    n : ndarray of int, shape (n_exposures - 1,)
        How many pixels told.
    black_error, black_sigma : ndarray, shape (n_exposures - 1,)
        By how many counts the black level that was subtracted is too low, as each pair of exposures has it.
    """

    nominal: Array
    ratio: Array
    sigma: Array
    n: NDArray[np.int64]
    black_error: Array
    black_sigma: Array

    @classmethod
    def of_one_exposure(cls) -> ExposureRatios:
        """Return the ratios of a single exposure: none."""
        none = np.zeros(0)
        return cls(none, none, none, np.zeros(0, np.int64), none, none)

    @property
    def deviation(self) -> Array:
        """Relative difference from the nominal ratios, shape (n_exposures - 1,)."""
        return self.ratio / self.nominal - 1.0

    @property
    def adopted(self) -> NDArray[np.bool_]:
        """Which ratios differ from the nominal ones by more than their error, so that they are to be used instead."""
        error = np.hypot(self.sigma / self.nominal, _SYSTEMATIC)
        with np.errstate(invalid="ignore"):
            return np.asarray(np.abs(self.deviation) > 3.0 * error)

    @property
    def time_factors(self) -> Array:
        """What to multiply the reported times by, shape (n_exposures,), ascending times.

        The longest stays: errors of a shutter are alike for all times, and so smallest in proportion there.
        """
        log_factor = np.where(self.adopted, np.log(np.where(self.adopted, self.ratio / self.nominal, 1.0)), 0.0)
        return np.asarray(np.exp(-np.concatenate([np.cumsum(log_factor[::-1])[::-1], [0.0]])))

    @property
    def slope(self) -> float:
        """Slope of log counts over log exposure time, 1 for a linear camera; NaN where a ratio is missing."""
        log_time = np.concatenate([[0.0], np.cumsum(np.log(self.nominal))])
        log_counts = np.concatenate([[0.0], np.cumsum(np.log(self.ratio))])
        return float(np.polyfit(log_time, log_counts, 1)[0]) if np.isfinite(log_counts).all() else np.nan


def estimate_exposure_ratios(samples: Array, trusted: Array, exposure_times: Array, sensor: Sensor) -> ExposureRatios:
    """Estimate the ratios from one set of frames.

    Parameters
    ----------
    samples : ndarray, shape (n_exposures, n_pixels)
        Counts above black; some 10 000 pixels of all brightnesses will do.
    trusted : ndarray, shape (n_pixels,)
        Counts above black up to which each pixel is believed.
    exposure_times : ndarray, shape (n_exposures,)
        Seconds, ascending, as the camera reported them.
    sensor : Sensor

    Raises
    ------
    ValueError
        If the times do not ascend, or are not one for each exposure.
    """
    if len(samples) != len(exposure_times) or not np.all(np.diff(exposure_times) > 0.0):
        raise ValueError(f"exposure_times are {exposure_times} s; they must ascend, one for each of {len(samples)}.")
    nominal = exposure_times[1:] / exposure_times[:-1]
    pairs = zip(samples[:-1], samples[1:], nominal, strict=True)
    found = np.array([_ratio(x, y, trusted, r, sensor) for x, y, r in pairs]).reshape(-1, 5)
    ratio, sigma, n, black_error, black_sigma = found.T
    return ExposureRatios(nominal, ratio, sigma, n.astype(np.int64), black_error, black_sigma)


def combine_ratios(sets: Sequence[ExposureRatios]) -> ExposureRatios:
    """Combine the ratios of several sets of frames; where they scatter more than stated, sigma grows to match.

    Raises
    ------
    ValueError
        If there is no set.
    """
    if not sets:
        raise ValueError("there is no set of frames; ratios come from one at least.")
    nominal = sets[0].nominal
    deviation, spread = _weighted_mean([s.deviation for s in sets], [s.sigma / nominal for s in sets])
    black_error, black_sigma = _weighted_mean([s.black_error for s in sets], [s.black_sigma for s in sets])
    n = reduce(np.add, [s.n for s in sets])
    return ExposureRatios(nominal, nominal * (1.0 + deviation), nominal * spread, n, black_error, black_sigma)


def _weighted_mean(values: Sequence[Array], sigmas: Sequence[Array]) -> tuple[Array, Array]:
    """Return means over the sets and their sigmas, those widened where the values scatter more."""
    value, weight = np.stack(values), 1.0 / np.stack(sigmas) ** 2
    total = weight.sum(axis=0)
    known = total > 0.0
    divisor = np.where(known, total, 1.0)
    mean = np.where(known, np.nansum(weight * value, axis=0) / divisor, np.nan)
    chi2 = np.nansum(weight * (value - mean) ** 2, axis=0) / max(len(values) - 1, 1)
    return mean, np.where(known, np.sqrt(np.maximum(chi2, 1.0) / divisor), np.inf)


def _ratio(x: Array, y: Array, trusted: Array, nominal: float, sensor: Sensor) -> tuple[float, ...]:
    """Return ratio, its sigma, the number of pixels, the black level's error and its sigma of two exposures."""
    r, c, covariance, n = float(nominal), 0.0, np.full((2, 2), np.inf), 0
    black_sigma = _BLACK_SIGMA * (sensor.step or np.sqrt(sensor.read_variance) or 1e-6)
    for _ in range(_ROUNDS):
        best, var_x, var_y = _best_estimate(x, y - c, r, sensor)
        use = (best > _DARKEST * np.sqrt(sensor.read_variance)) & (r * best < _BRIGHTEST * trusted)
        n = int(np.count_nonzero(use))
        if n < _MIN_PIXELS:
            return np.nan, np.inf, n, np.nan, np.inf
        variance = (var_y + r * r * var_x)[use]
        r, c, covariance = _instrumental_fit(x[use], y[use], best[use], variance, r, c, black_sigma)
    ratio_sigma, shift_sigma = np.sqrt(np.diag(covariance))
    if r == 1.0:  # the same black in both: they say nothing of its error
        return r, ratio_sigma, n, 0.0, np.inf
    return r, ratio_sigma, n, c / (1.0 - r), shift_sigma / abs(1.0 - r)


def _best_estimate(x: Array, y: Array, r: float, sensor: Sensor) -> tuple[Array, Array, Array]:
    """Return the counts in the shorter exposure by both exposures, and the variances of x and of y."""
    light = np.maximum((x + y) / (1.0 + r), 0.0)
    var_x = light / sensor.conversion_gain + sensor.read_variance
    var_y = r * light / sensor.conversion_gain + sensor.read_variance
    return (x / var_x + r * y / var_y) / (1.0 / var_x + r * r / var_y), var_x, var_y


def _instrumental_fit(
    x: Array, y: Array, best: Array, variance: Array, r: float, c: float, black_sigma: float
) -> tuple[float, float, Array]:
    """Take one step of y = r x + c against `best`, with Tukey's weights: what moved has none.

    Return r, c and their covariance.
    """
    z = np.abs(y - r * x - c) / np.sqrt(variance)
    scale = mad_sigma(z, 1.0)
    weight = tukey_weights(z, _TUKEY * scale) / variance
    Z, X = np.stack([best, np.ones_like(best)]), np.stack([x, np.ones_like(x)])
    M = (Z * weight) @ X.T
    # Two frames of one exposure time have the same black: c is 0, however well the black is known.
    M[1, 1] += 1.0 / max(black_sigma * abs(1.0 - r), _EXACT) ** 2
    r, c = np.linalg.solve(M, Z @ (weight * y))
    return float(r), float(c), np.asarray(scale**2 * np.linalg.inv(M), np.float64)
