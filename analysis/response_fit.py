"""The response curve of a bracket, with the smoothness that predicts blocks left out of the fit best."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.response import Response, srgb
from analysis.response_samples import BracketSamples, bracket_samples
from analysis.response_solver import MIDDLE, at, best_light, curve_sigma, less_mean, misfit_of, solve, variance_of

Array = NDArray[np.float64]

SMOOTHNESS = tuple(10.0 ** np.arange(-2.0, 5.0))
"""Weights of the curve's roughness to choose from."""

_FOLDS = 4
_MIDDLE_LIGHT = float(srgb(np.array(MIDDLE)))


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
