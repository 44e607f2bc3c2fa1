"""Estimates black, clipping, exposure times, noise and response of a camera from the pictures of a session."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.radiometry.conversion import Radiometry, RadiometryFindings, linear_counts
from analysis.radiometry.exposure_ratios import ExposureRatios, combine_ratios, estimate_exposure_ratios
from analysis.radiometry.hdr import Sensor, trusted_level
from analysis.radiometry.mosaic import cell_shape
from analysis.radiometry.response import Response, table_response
from analysis.radiometry.response_fit import PicturePrediction, fit_response, predict_each
from analysis.radiometry.sampling import FrameSamples, cell_medians, sample_frames, spread_poses
from analysis.radiometry.saturation import find_saturation
from analysis.radiometry.sensor_noise import assumed_sensor, estimate_noise_model
from instrument.files.validation import InvalidInputError, Problem
from instrument.session.records import CameraRecord
from instrument.session.session import Session

Array = NDArray[np.float64]

N_POSES = 6
"""Poses that are looked at, spread over the session."""


def survey(session: Session) -> Radiometry:
    """Look at some poses of a session.

    Parameters
    ----------
    session : Session
        With one complete pose at least.

    Raises
    ------
    InvalidInputError
        If its response curve, or the bracket for one, cannot be used.
    """
    poses = [(int(i), session.frame_ok[i]) for i in spread_poses(session.pose_complete, N_POSES)]
    response, slope, predictions = _response(session)
    # One bracket tells the shape and the kind of all.
    first = session.frames(poses[0][0])
    nominal = _nominal_black(session, response, first)
    dark = None if response is not None else session.dark
    black = nominal if dark is None else dark
    stated = _stated_sensor(session.camera, response)
    sensor = stated or assumed_sensor(_finite_range(session, poses), float(nominal.mean()), _step(first))
    saturation = None
    if response is None and sensor.step > 0.0:
        frames = (frame for i, ok in poses for frame in session.frames(i)[ok])
        saturation = find_saturation(frames, session.camera.saturation_value, float(nominal.mean()), sensor)
        sensor = replace(sensor, saturation_level=saturation.level)
    sampled = [_sampled(session, i, ok, sensor, black, response) for i, ok in poses]
    brackets = [s for s in sampled if len(s.counts) == len(session.exposure_times)]
    sensor = sensor if stated else _with_noise(sensor, brackets)
    ratios = _ratios(brackets, sensor)
    medians = None if dark is None else cell_medians(dark)
    findings = RadiometryFindings(
        black_nominal=nominal,
        black_used=nominal if medians is None else medians,
        black_dark=medians,
        saturation=saturation,
        ratios=ratios,
        share_all_clipped=float(np.mean([s.all_clipped.mean() for s in sampled])),
        n_nan=sum(int(np.isnan(s.counts).sum()) for s in sampled),
        n_sampled=sum(s.counts.size for s in sampled),
        noise_estimated=stated is None,
        response=response,
        response_slope=slope,
        response_predictions=predictions,
    )
    n_exposures = len(session.exposure_times)
    factors = np.ones(n_exposures) if response is not None else _time_factors(ratios, session.exposure_times)
    return Radiometry(sensor, black, response, factors, findings)


def _response(session: Session) -> tuple[Response | None, float, tuple[PicturePrediction, ...]]:
    """Return the curve that a session has, or the one that its bracket gives with what that says of itself."""
    given, times = session.nominal.response, session.extra.response_times
    if given is not None:
        return table_response(np.asarray(given, np.float64)), np.nan, ()
    if len(times) == 0:
        return None, np.nan, ()
    pictures = np.stack([session.extra.response_images(i) for i in range(len(times))])
    if pictures.max() > np.iinfo(np.uint8).max:
        problem = Problem("response pictures", f"have counts up to {pictures.max()}; a curve is found for 8-bit ones")
        raise InvalidInputError("The response curve cannot be found.", [problem])
    eight_bit = pictures.astype(np.uint8)
    fit = fit_response(eight_bit, times)
    return fit.response, fit.slope, predict_each(eight_bit, times, fit.smoothness)


def _nominal_black(session: Session, response: Response | None, first: NDArray[Any]) -> Array:
    """Return the stated black level of each place of the cell; linear light has none."""
    shape = cell_shape(first)
    if response is not None:
        return np.zeros(shape)
    cell = session.nominal.black_level_cell
    return np.full(shape, session.camera.black_level) if cell is None else np.asarray(cell, np.float64)


def _stated_sensor(camera: CameraRecord, response: Response | None) -> Sensor | None:
    """Return the sensor, None if its noise is not stated."""
    if response is not None:
        return response.sensor()
    if not (np.isfinite(camera.conversion_gain) and np.isfinite(camera.read_noise)):
        return None
    step = 1.0 if np.isfinite(camera.saturation_value) else 0.0
    return Sensor(camera.saturation_value, camera.conversion_gain, camera.read_noise, step)


def _step(first: NDArray[Any]) -> float:
    return 1.0 if np.issubdtype(first.dtype, np.integer) else 0.0


def _finite_range(session: Session, poses: list[tuple[int, NDArray[np.bool_]]]) -> float:
    """Return the counts at which the camera clips, or the largest ones where it does not."""
    nominal = session.camera.saturation_value
    if np.isfinite(nominal):
        return nominal
    return max(float(np.nanmax(session.frames(i)[ok])) for i, ok in poses)


def _sampled(
    session: Session, i: int, ok: NDArray[np.bool_], sensor: Sensor, black: NDArray[Any], response: Response | None
) -> FrameSamples:
    dark = black[ok] if black.ndim > 2 else black
    frames = linear_counts(session.frames(i)[ok], response)
    return sample_frames(frames, session.exposure_readback[i][ok], dark, trusted_level(dark, sensor))


def _with_noise(assumed: Sensor, brackets: Sequence[FrameSamples]) -> Sensor:
    """Return the sensor with the noise that brackets have, the median of them, or as it was assumed."""
    found = [estimate_noise_model(b.counts, b.trusted, b.exposure_times, assumed) for b in brackets if _ascends(b)]
    known = [f for f in found if f is not None]
    if not known:
        return assumed
    gain, read_noise = np.median(known, axis=0)
    return replace(assumed, conversion_gain=float(gain), read_noise=float(read_noise))


def _ratios(brackets: Sequence[FrameSamples], sensor: Sensor) -> ExposureRatios:
    sets = [
        estimate_exposure_ratios(b.counts, b.trusted, b.exposure_times, sensor) for b in brackets if _ascends(b)
    ]  # fmt: skip
    return combine_ratios(sets) if sets else ExposureRatios.of_one_exposure()


def _ascends(bracket: FrameSamples) -> bool:
    return len(bracket.exposure_times) > 1 and bool(np.all(np.diff(bracket.exposure_times) > 0.0))


def _time_factors(ratios: ExposureRatios, exposure_times: Array) -> Array:
    factors = np.ones(len(exposure_times))
    if len(ratios.nominal) == len(exposure_times) - 1 > 0:
        factors[np.argsort(exposure_times, kind="stable")] = ratios.time_factors
    return factors
