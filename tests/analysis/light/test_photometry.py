from dataclasses import replace

import numpy as np
import pytest

from analysis.camera.view import View
from analysis.light.photometry import Photometry, WhiteSamples, fit_photometry
from tests.synthetic import camera_ring

SIZE = (640, 480)
MATRIX = np.array([[1000.0, 0.0, 321.0], [0.0, 1000.0, 242.0], [0.0, 0.0, 1.0]])
OFFSET = np.array([12.0, -4.0, 0.0])
A, B, M = -0.35, 0.08, 1.5
N_VIEWS = 24


def looking_at_centre(camera: np.ndarray) -> View:
    forward = -camera / np.linalg.norm(camera)
    right = np.cross(forward, [0.0, 1.0, 0.3])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return View(MATRIX, np.zeros(5), rotation, -rotation @ camera)


VIEWS = tuple(looking_at_centre(c) for c in camera_ring(N_VIEWS, distance=200.0, widest_deg=45.0))
POWER = np.pi * 2e5 * (1.0 + 0.02 * np.random.default_rng(3).standard_normal(N_VIEWS))


def white_samples(noise: float, rng: np.random.Generator, whiteness: tuple[float, float] = (1.0, 1.0)) -> WhiteSamples:
    """Return what two Lambertian sheets of BRDF `whiteness` / pi show, by the formula, for a ring of points."""
    x, y = np.meshgrid(np.linspace(-55.0, 55.0, 14), np.linspace(-42.0, 42.0, 11))
    points = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    points = points[np.abs(points[:, 0]) + np.abs(points[:, 1]) > 35.0]
    sheet = (points[:, 0] > 0.0).astype(np.int64)
    columns: dict[str, list[np.ndarray]] = {name: [] for name in ("log", "view", "sheet", "point", "pixel")}
    for v, view in enumerate(VIEWS):
        seen = points @ view.rotation.T + view.translation
        pixel = seen[:, :2] / seen[:, 2:] * 1000.0 + [321.0, 242.0]
        to_light = view.rotation.T @ (OFFSET - view.translation) - points
        d2 = np.sum(to_light**2, axis=1)
        cos_i = to_light[:, 2] / np.sqrt(d2)
        radiance = POWER[v] * np.array(whiteness)[sheet] / np.pi * cos_i / d2 * falloff(pixel, seen)
        columns["log"].append(np.log(radiance) + noise * rng.standard_normal(len(points)))
        columns["view"].append(np.full(len(points), v))
        columns["sheet"].append(sheet)
        columns["point"].append(points)
        columns["pixel"].append(pixel)
    return WhiteSamples(*(np.concatenate(column) for column in columns.values()))


def falloff(pixel: np.ndarray, seen: np.ndarray) -> np.ndarray:
    """Vignetting times the light's lobe at points at `seen` of the camera frame."""
    r2 = np.sum((pixel - [321.0, 242.0]) ** 2, axis=-1) / (np.hypot(*SIZE) / 2.0) ** 2
    ray = seen - OFFSET
    return np.exp(A * r2 + B * r2**2) * (ray[..., 2] / np.linalg.norm(ray, axis=-1)) ** M


@pytest.fixture(scope="module")
def samples() -> WhiteSamples:
    return white_samples(0.005, np.random.default_rng(0))


@pytest.fixture(scope="module")
def photometry(samples: WhiteSamples) -> Photometry:
    return fit_photometry(samples, VIEWS, OFFSET, SIZE)


def relative(power: np.ndarray) -> np.ndarray:
    return power / power.mean()


def test_the_powers_of_the_views_are_found_to_half_a_percent(photometry: Photometry):
    np.testing.assert_allclose(relative(photometry.light_power), relative(POWER), rtol=0.005)


def test_the_power_is_such_that_white_has_the_brdf_of_white(photometry: Photometry):
    assert photometry.light_power.mean() == pytest.approx(POWER.mean(), rel=0.02)


def test_vignetting_and_lobe_together_are_found_to_one_percent(photometry: Photometry, samples: WhiteSamples):
    """Apart they are hardly told: both fall off from nearly the same centre."""
    for view in VIEWS[::6]:
        points = samples.point[samples.view == 0]
        seen = points @ view.rotation.T + view.translation
        pixel = seen[:, :2] / seen[:, 2:] * 1000.0 + [321.0, 242.0]
        ours, truth = photometry.falloff(view, OFFSET, points, pixel), falloff(pixel, seen)
        np.testing.assert_allclose(ours / ours.mean(), truth / truth.mean(), rtol=0.01)


def test_the_residual_is_the_noise(photometry: Photometry):
    assert photometry.rms == pytest.approx(0.005, rel=0.1)


def test_a_greyer_sheet_does_not_disturb_the_powers():
    grey = white_samples(0.005, np.random.default_rng(1), whiteness=(1.0, 0.93))
    power = fit_photometry(grey, VIEWS, OFFSET, SIZE).light_power
    np.testing.assert_allclose(relative(power), relative(POWER), rtol=0.005)


def test_five_percent_of_wrong_samples_are_tolerated(samples: WhiteSamples):
    log_radiance = samples.log_radiance.copy()
    log_radiance[np.random.default_rng(2).random(len(log_radiance)) < 0.05] -= 1.5
    power = fit_photometry(replace(samples, log_radiance=log_radiance), VIEWS, OFFSET, SIZE).light_power
    np.testing.assert_allclose(relative(power), relative(POWER), rtol=0.008)


def test_without_noise_the_powers_are_exact():
    power = fit_photometry(white_samples(0.0, np.random.default_rng(0)), VIEWS, OFFSET, SIZE).light_power
    np.testing.assert_allclose(relative(power), relative(POWER), rtol=1e-3)
