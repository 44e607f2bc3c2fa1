"""Where the light stands and how it falls off."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.evaluation.metrics import angular_error_deg
from analysis.light.flat_field import WARN_GAIN, fit_flat_field
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import reconstruct
from analysis.registration.grid import Grid
from analysis.registration.stack import Stack
from analysis.registration.stack_file import read_stack, write_stack
from tests.analysis.light import test_flat_field as flats
from tests.analysis.light.flats import prediction_error
from tests.checks.conftest import Record
from tests.synthetic import camera_ring, make_stack

BASELINE = (12.0, 0.0, 0.0)


@pytest.mark.check(8)
def test_a_plane_that_was_left_out_is_predicted_by_the_flat_field(record: Record) -> None:
    pictures = flats.poses()
    errors = []
    for i, left_out in enumerate(pictures):
        field = fit_flat_field([p for k, p in enumerate(pictures) if k != i], flats.OFFSET)
        errors.append(prediction_error(field, left_out))
    record.at_most("plane left out, measured over predicted, RMS less its own power", 100.0 * max(errors), 1.0, "%")


@pytest.mark.check(8)
def test_a_flat_field_that_corrects_by_more_than_two_is_told(record: Record) -> None:
    field = fit_flat_field(flats.poses(), flats.OFFSET)
    x, y = np.meshgrid(np.arange(flats.WIDTH), np.arange(flats.HEIGHT))
    true = flats.true_gain(np.stack([x, y], axis=-1).astype(float), 150.0)
    largest = true.max() / true.min()
    assert largest > WARN_GAIN
    record.at_least("largest correction of a strong flat field, found", field.max_gain(150.0), WARN_GAIN)
    off = abs(field.max_gain(150.0) / largest - 1.0)
    record.at_most("the same over the true one, less 1", 100.0 * off, 1.0, "%")


def lambertian_plane(albedo: float, size: int = 24, extent: float = 100.0, noise: float = 0.003) -> Stack:
    """A plane of `extent` mm seen from 350 mm by Lambert's law, light and camera in one place."""
    camera = camera_ring(40, 350.0, 50.0)
    points = Grid(size, size, extent / size).points()
    to_light = camera[:, None, None] - points
    d = np.linalg.norm(to_light, axis=-1)
    clean = albedo / np.pi * to_light[..., 2] / d**3
    noisy = clean * (1.0 + noise * np.random.default_rng(0).standard_normal(clean.shape))
    return Stack(
        radiance=noisy[..., None].astype(np.float32),
        camera_position=camera,
        light_position=camera,
        pixel_pitch=extent / size,
        light_power=np.ones(len(camera)),
        variance=((noise * clean) ** 2)[..., None].astype(np.float32),
    )


@pytest.mark.check(9)
def test_a_plane_as_wide_as_a_third_of_its_distance_is_flat(record: Record) -> None:
    stack = lambertian_plane(0.6)
    up = np.broadcast_to([0.0, 0.0, 1.0], (24, 24, 3))
    near, far = (
        angular_error_deg(reconstruct(stack, Options(field=f, palette="off")).normals, up).mean()
        for f in ("auto", "far")
    )
    record.at_most("normals of a 100 mm plane at 350 mm, mean error", near, 0.3, "°")
    record.at_least("the same with camera and light taken for far away", far, 0.3, "°")


def theta_d_deg(stack: Stack) -> np.ndarray:
    """Half the angle between light and camera at the middle of the area, each view, degrees."""
    omega_i, omega_o = (
        p / np.linalg.norm(p, axis=1, keepdims=True) for p in (stack.light_position, stack.camera_position)
    )
    return 0.5 * np.rad2deg(np.arccos(np.sum(omega_i * omega_o, axis=1)))


@pytest.mark.check(10)
def test_the_place_of_the_light_is_kept_for_each_view_and_used(record: Record, tmp_path: Path) -> None:
    made = make_stack(n_views=40, size=20, light_offset=BASELINE)
    write_stack(tmp_path / "s.stack.h5", made)
    stack = read_stack(tmp_path / "s.stack.h5")
    true = 0.5 * np.rad2deg(np.arctan(12.0 / 350.0))
    record.at_most(
        "θ_d of each view from the stack's file, less the true one", np.abs(theta_d_deg(stack) - true).max(), 0.01, "°"
    )
    used, ignored = (reconstruct(stack, Options(light=light, palette="off")) for light in ("given", "collocated"))
    sigma = np.sqrt(2.0) * np.rad2deg(np.sqrt(np.mean(used.fits.normal_sigma**2)))
    rms = [np.sqrt(np.mean(angular_error_deg(r.normals, made.truth.normals) ** 2)) / sigma for r in (used, ignored)]
    record.at_most("normal error with a light 12 mm from the lens, in stated sigmas, RMS", rms[0], 1.5)
    record.at_least("the same with the light taken to be in the lens", rms[1], 1.5)
