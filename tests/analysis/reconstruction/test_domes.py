"""A camera that never moves, and lights far from it."""

from dataclasses import replace

import numpy as np
import pytest

from analysis.evaluation.metrics import angular_error_deg
from analysis.evaluation.scoring import score
from analysis.pixels.trimming import SKEWED, skewness, without_highlights
from analysis.reconstruction.effects import MAX_THETA_D_DEG, choose_dictionary, theta_d_sigma
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import Reconstruction, reconstruct
from analysis.registration.lighting import camera_moves, theta_d_deg
from analysis.registration.stack import Stack
from analysis.results.trust import failures
from benchmarks.common.scenes import cap, relief


@pytest.fixture(scope="module")
def dome() -> Stack:
    """A matte relief with some gloss, lit from 24 far directions up to 50 deg off a fixed camera."""
    rng = np.random.default_rng(0)
    scene = relief(32, 24, 0.01, 0, table="abc")
    assert scene.stack.truth is not None
    light = 1e4 * cap(24, rng, 50.0)
    camera = np.tile([0.0, 0.0, 1e4], (24, 1))
    normals = scene.normals
    points = scene.stack.grid.points(scene.stack.truth.depth).reshape(-1, 3)
    to_light = light[:, None] - points
    omega_i = to_light / np.linalg.norm(to_light, axis=-1, keepdims=True)
    h = omega_i + np.array([0.0, 0.0, 1.0])
    h /= np.linalg.norm(h, axis=-1, keepdims=True)
    lobe = 1.5 * np.maximum(np.sum(normals * h, axis=-1), 0.0) ** 120
    radiance = (0.3 + lobe) * np.maximum(np.sum(normals * omega_i, axis=-1), 0.0)
    radiance = radiance.reshape(24, 32, 32, 1) * np.array([1.0, 0.8, 0.6]) * (1.0 + 0.005 * rng.standard_normal(1))
    return replace(
        scene.stack,
        radiance=radiance.astype(np.float32),
        variance=((0.01 * radiance) ** 2 + 1e-6).astype(np.float32),
        camera_position=camera,
        light_position=light,
        light_power=np.full(24, 1e8),
        camera_rotation=None,
    )


@pytest.fixture(scope="module")
def solved(dome: Stack) -> Reconstruction:
    return reconstruct(dome)


def test_it_is_seen_that_the_camera_never_moves_and_how_far_the_lights_are(dome: Stack):
    assert not camera_moves(dome)
    assert camera_moves(relief(8, 8, 0.01, 0).stack)
    assert np.median(theta_d_deg(dome)) > MAX_THETA_D_DEG
    assert theta_d_deg(relief(8, 8, 0.01, 0).stack).max() < 1.5


def test_a_dome_is_taken_as_lambertian_and_solved_well(dome: Stack, solved: Reconstruction):
    chosen = {choice.effect: choice for choice in solved.choices}
    assert chosen["dictionary"].chosen == "lambert"
    assert chosen["palette"].chosen == "off"
    assert angular_error_deg(solved.normals, dome.truth.normals).mean() < 1.5


def test_its_sigma_knows_of_the_model(dome: Stack, solved: Reconstruction):
    assert theta_d_sigma(dome) > np.deg2rad(1.0)
    assert theta_d_sigma(relief(8, 8, 0.01, 0).stack) == 0.0
    error = angular_error_deg(solved.normals, dome.truth.normals).ravel()
    assert np.mean(error < 2.4477 * np.rad2deg(solved.fits.normal_sigma)) > 0.88


def test_the_user_is_told(solved: Reconstruction):
    (text,) = failures(score(solved, n_held_out=0))
    assert "OUTSIDE THE DOMAIN" in text
    assert "camera never moves" in text


def test_a_dictionary_that_is_named_is_taken(dome: Stack):
    assert choose_dictionary(dome, "abc").value.name == "abc"
    assert choose_dictionary(dome, "lambert").choice.reason == "forced by option"
    assert Options().dictionary == "auto"


def test_highlights_are_left_out_where_there_are_any(dome: Stack):
    trimmed = without_highlights(dome)
    kept = np.isfinite(trimmed.radiance[..., 0]).mean(axis=0)
    assert np.all((kept > 0.3) & (kept < 0.5))
    matte = replace(dome, radiance=np.minimum(dome.radiance, np.quantile(dome.radiance, 0.5, axis=0) * 1.2))
    assert skewness(dome) > SKEWED
    assert skewness(matte) < skewness(dome)


def test_a_matte_surface_keeps_all_its_samples(dome: Stack):
    rng = np.random.default_rng(1)
    assert dome.truth is not None
    light = dome.light_position / np.linalg.norm(dome.light_position, axis=1, keepdims=True)
    shading = np.maximum(np.einsum("vi,hwi->vhw", light, dome.truth.normals), 0.0)[..., None].repeat(3, axis=-1)
    matte = replace(dome, radiance=(shading * (1.0 + 0.02 * rng.standard_normal(shading.shape))).astype(np.float32))
    assert without_highlights(matte) is matte


def test_few_lights_leave_a_pixel_enough_to_be_solved(dome: Stack):
    few = replace(
        dome,
        radiance=dome.radiance[:8],
        variance=dome.variance[:8],
        camera_position=dome.camera_position[:8],
        light_position=dome.light_position[:8],
        light_power=dome.light_power[:8],
    )
    assert np.isfinite(without_highlights(few).radiance[..., 0]).sum(axis=0).min() >= 6
