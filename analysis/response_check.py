"""Whether a bracket obeys its response curve: each picture predicted from the others."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.response import N_LEVELS
from analysis.response_fit import ResponseFit, fit_samples
from analysis.response_samples import BracketSamples, bracket_samples

Array = NDArray[np.float64]

SLOPE_TOLERANCE = 0.01
"""How far the slope of log linear exposure over log time may be from 1 before a report warns."""


@dataclass(frozen=True, slots=True)
class PicturePrediction:
    """How well one picture of a bracket follows from the others.

    Attributes
    ----------
    exposure_time : float
        Reported, seconds.
    n : int
        Blocks compared, over all channels; 0 if no other picture shows what this one does.
    rms_counts, median_counts : float
        Of seen less predicted counts, and of their absolute values; NaN without blocks.
    rms_relative : float
        Of log linear exposure.
    offset : float
        Median of log linear exposure, seen less predicted: by how much this picture is too bright for its time.
    """

    exposure_time: float
    n: int
    rms_counts: float
    median_counts: float
    rms_relative: float
    offset: float


def predict_each(
    pictures: NDArray[np.uint8], exposure_times: Array, smoothness: float
) -> tuple[PicturePrediction, ...]:
    """Leave each picture out in turn, find curve and light from the others, and predict it for its reported time.

    Parameters
    ----------
    pictures : ndarray of uint8, shape (n_exposures, height, width, n_channels)
    exposure_times : ndarray, shape (n_exposures,)
        Seconds, as reported.
    smoothness : float
        Of the curve (`ResponseFit.smoothness`).

    Raises
    ------
    InvalidInputError
        If such a bracket cannot tell the curve, with the reasons.
    """
    samples = bracket_samples(pictures, exposure_times)
    return tuple(_predict(samples, j, smoothness) for j in range(len(exposure_times)))


def _predict(samples: BracketSamples, j: int, smoothness: float) -> PicturePrediction:
    time = float(samples.exposure_times[j])
    others = np.arange(len(samples.exposure_times)) != j
    kept = replace(
        samples,
        counts=samples.counts[..., others],
        valid=samples.valid[..., others],
        exposure_times=samples.exposure_times[others],
    )
    fit = fit_samples(kept, smoothness)
    compared = samples.valid[..., j] & kept.valid.any(axis=-1)
    if not compared.any():
        return PicturePrediction(time, 0, np.nan, np.nan, np.nan, np.nan)
    return _compared(fit, samples.counts[..., j], compared, time)


def _compared(fit: ResponseFit, counts: Array, compared: NDArray[np.bool_], time: float) -> PicturePrediction:
    """Compare the counts of a picture, shape (n_channels, n_samples), with the light that the others show."""
    levels, log_curve = np.arange(N_LEVELS), np.log(fit.response.curve)
    expected = fit.log_light + np.log(time)
    in_counts, in_light = [], []
    for c, use in enumerate(compared):
        in_counts.append((counts[c] - np.interp(expected[c], log_curve[c], levels))[use])
        in_light.append((np.interp(counts[c], levels, log_curve[c]) - expected[c])[use])
    off, light = np.concatenate(in_counts), np.concatenate(in_light)
    return PicturePrediction(
        exposure_time=time,
        n=len(off),
        rms_counts=float(np.sqrt(np.mean(off**2))),
        median_counts=float(np.median(np.abs(off))),
        rms_relative=float(np.sqrt(np.mean(light**2))),
        offset=float(np.median(light)),
    )
