"""The response curve of a bracket, with the smoothness that predicts blocks left out of the fit best."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.radiometry.response import N_LEVELS, Response, srgb
from analysis.radiometry.response_solver import (
    MIDDLE,
    BracketSamples,
    at,
    best_light,
    bracket_samples,
    curve_sigma,
    less_mean,
    misfit_of,
    solve,
    variance_of,
)

Array = NDArray[np.float64]

SMOOTHNESS = tuple(10.0 ** np.arange(-2.0, 5.0))
"""Weights of the curve's roughness to choose from."""

_FOLDS = 4

_MIDDLE_LIGHT = float(srgb(np.array(MIDDLE)))

SLOPE_TOLERANCE = 0.01
"""How far the slope of log linear exposure over log time may be from 1 before a report warns."""


@dataclass(frozen=True, slots=True)
class ResponseFit:
    """A response curve with what the bracket says of itself.

    Attributes
    ----------
    response : Response
    exposure_times : ndarray, shape (n_exposures,)
        Estimated, seconds; their geometric mean follows the reported ones within the prior.
    reported_times : ndarray, shape (n_exposures,)
        Seconds.
    smoothness : float
        Weight of the roughness, chosen by cross-validation.
    slope : float
        Slope of log linear exposure over log reported time within a block; 1 for a curve that is right.
    rms : float
        Of log exposure, over all blocks.
    log_light : ndarray, shape (n_channels, n_samples)
        Log of the linear exposure of each block in one second.
    """

    response: Response
    exposure_times: Array
    reported_times: Array
    smoothness: float
    slope: float
    rms: float
    log_light: Array


def fit_response(pictures: NDArray[np.uint8], exposure_times: Array) -> ResponseFit:
    """Find the response curve of each channel.

    Parameters
    ----------
    pictures : ndarray of uint8, shape (n_exposures, height, width, n_channels)
    exposure_times : ndarray, shape (n_exposures,)
        Seconds, as reported.

    Raises
    ------
    InvalidInputError
        If such a bracket cannot tell the curve, with the reasons.
    """
    samples = bracket_samples(pictures, exposure_times)
    smoothness = min(SMOOTHNESS, key=lambda s: _error_left_out(samples, s))
    return fit_samples(samples, smoothness)


def fit_samples(samples: BracketSamples, smoothness: float) -> ResponseFit:
    """Find the response curve from chosen blocks."""
    state = solve(samples, smoothness)
    # Relative exposure is what a picture can tell; sRGB's at mid-range makes curves easy to compare.
    curve = np.exp(state.g - state.g[:, MIDDLE : MIDDLE + 1]) * _MIDDLE_LIGHT
    used = samples.counts[samples.valid]
    log_exposure, log_time = at(state.g, samples.counts), np.log(samples.exposure_times)
    residual = log_exposure - state.light[..., None] - log_time - state.time_error
    return ResponseFit(
        response=Response(curve, curve_sigma(state), int(used.min()), int(used.max())),
        exposure_times=samples.exposure_times * np.exp(state.time_error),
        reported_times=samples.exposure_times,
        smoothness=smoothness,
        slope=_slope(log_exposure, log_time, samples.valid / variance_of(state, samples)),
        rms=float(np.sqrt(np.mean(residual[samples.valid] ** 2))),
        log_light=state.light - state.g[:, MIDDLE, None] + np.log(_MIDDLE_LIGHT),
    )


def _error_left_out(samples: BracketSamples, smoothness: float) -> float:
    """Return how badly blocks that were left out obey the curve: robust mean of their misfits in sigmas."""
    fold = np.arange(samples.counts.shape[1]) % _FOLDS
    total = 0.0
    for k in range(_FOLDS):
        state = solve(_subset(samples, fold != k), smoothness)
        left_out = _subset(samples, fold == k)
        weight = left_out.valid.astype(np.float64)
        state = replace(state, light=np.zeros(left_out.counts.shape[:2]))
        for _ in range(3):
            state = replace(state, light=best_light(state, left_out, weight))
            weight = left_out.valid / variance_of(state, left_out)
        z = misfit_of(state, left_out) * np.sqrt(weight)
        total += float(np.sqrt(1.0 + z[left_out.valid] ** 2).mean())
    return total


def _subset(samples: BracketSamples, use: NDArray[np.bool_]) -> BracketSamples:
    return replace(samples, counts=samples.counts[:, use], valid=samples.valid[:, use])


def _slope(log_exposure: Array, log_time: Array, weight: Array) -> float:
    """Return the slope of log exposure over log time within blocks."""
    flat = weight.reshape(-1, weight.shape[-1])
    t = less_mean(np.broadcast_to(log_time, flat.shape)[..., None], flat)[..., 0]
    y = less_mean(log_exposure.reshape(flat.shape)[..., None], flat)[..., 0]
    return float((flat * t * y).sum() / (flat * t * t).sum())


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
