"""Calibrations for tests of their checks and their report, made up where a real one would take long."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

from analysis.calibration.light import Lighting
from analysis.calibration.session import Calibration
from analysis.camera.board_findings import board_findings
from analysis.camera.board_layout import BoardLayout
from analysis.camera.calibration import CameraCalibration, views_of
from analysis.light.photometry import WhiteSamples, fit_photometry
from analysis.radiometry.conversion import RadiometryFindings
from analysis.radiometry.exposure_ratios import ExposureRatios
from analysis.radiometry.saturation import Saturation
from analysis.registration.lighting import LightOffset
from analysis.reporting.checks import Check
from analysis.reporting.session_facts import SessionFacts
from tests.analysis.board_pictures import HEIGHT, WIDTH
from tests.analysis.camera.test_calibration import BOARDS, POSES, TRUE, calibrated, corners_from

SIZE = (WIDTH, HEIGHT)
OFFSET = np.array([11.0, -2.0, 0.0])
CELL = np.full((2, 2), 64.0)


def ratios(deviation: float = 0.0, black_error: float = 0.0) -> ExposureRatios:
    """Return three exposures, the last of which is off by `deviation`."""
    nominal = np.array([5.0, 4.0])
    small, n = np.full(2, 0.002), np.full(2, 9000)
    return ExposureRatios(nominal, nominal * [1.0, 1.0 + deviation], small, n, np.full(2, black_error), np.full(2, 0.1))


def radiometry(**changes: object) -> RadiometryFindings:
    """Return what is found of a good camera, but for `changes`."""
    good = RadiometryFindings(
        black_nominal=CELL,
        black_used=CELL,
        black_dark=CELL,
        saturation=Saturation(np.full((2, 2), 4095.0), 4095.0, np.ones((2, 2), bool), np.full((2, 2), 0.001)),
        ratios=ratios(),
        share_all_clipped=0.0,
        n_nan=0,
        n_sampled=10_000,
        noise_estimated=False,
        response=None,
        response_slope=np.nan,
        response_predictions=(),
    )
    return replace(good, **changes)


@cache
def camera() -> CameraCalibration:
    """Return a camera from 19 views of four boards."""
    return calibrated(corners_from(TRUE, np.random.default_rng(0)), focal_length_px=850.0)


@cache
def lighting() -> Lighting:
    """Return a light 11 mm beside the lens whose power falls by 1 %, found from white with 0.3 % of noise."""
    rng = np.random.default_rng(1)
    views = views_of(camera())
    power = 1e4 * np.linspace(1.005, 0.995, len(views))
    border = np.array([[x, y, 0.0] for x in np.linspace(-40, 40, 9) for y in (-32.0, 32.0)])
    log_radiance, view, pixel = [], [], []
    for v, of in enumerate(views):
        to_light = of.rotation.T @ (OFFSET - of.translation) - border
        shading = to_light[:, 2] / np.linalg.norm(to_light, axis=1) ** 3
        log_radiance.append(np.log(power[v] * shading) + 0.003 * rng.standard_normal(len(border)))
        view.append(np.full(len(border), v))
        pixel.append(of.project(border))
    white = WhiteSamples(
        np.concatenate(log_radiance),
        np.concatenate(view),
        np.zeros(len(views) * len(border), np.int64),
        np.tile(border, (len(views), 1)),
        np.concatenate(pixel),
    )
    offset = LightOffset(OFFSET, np.array([0.4, 0.4, 3.0]))
    return Lighting(fit_photometry(white, views, OFFSET, SIZE), offset, np.ones(1, np.float32), white)


def calibration(**changes: object) -> Calibration:
    """Return a good calibration, but for `changes`."""
    boards = board_findings(camera().bundle, BoardLayout.nominal(BOARDS), frozenset())
    # The first pose of the session shows no boards.
    i_pose = 1 + np.arange(len(POSES))
    good = Calibration(radiometry(), None, camera(), boards, lighting(), i_pose, ())
    return replace(good, **changes)


def facts(**changes: object) -> SessionFacts:
    """Return what is to be known of its session, but for `changes`."""
    n = len(POSES)
    known = SessionFacts(
        title="made up",
        digest="d16e57",
        image_size=SIZE,
        n_complete=n + 1,
        boards=BOARDS,
        area_mm=(40.0, 40.0),
        light_offset=np.array([12.0, 0.0, 0.0]),
        light_offset_sigma=np.full(3, 3.0),
        seconds=10.0 * np.arange(n),
        tilt_deg=None,
        turn_deg=None,
        worst_preview=np.full((HEIGHT // 4, WIDTH // 4), 7.0, np.float32),
    )
    return replace(known, **changes)


def named(checks: object, name: str) -> Check:
    """Return the one check of that name."""
    (found,) = [check for check in checks if check.name == name]
    return found
