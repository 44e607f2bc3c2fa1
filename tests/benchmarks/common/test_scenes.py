"""Scenes to measure against, and what is done to them."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.accuracy.alterations import at_wrong_distance, clipped, spoilt, with_gain_errors
from benchmarks.common.scenes import POSES, independent, relief


@pytest.mark.parametrize("poses", sorted(POSES))
def test_a_seed_makes_the_same_scene_again(poses: str) -> None:
    first, second = (independent(8, 12, 0.01, seed=4, poses=poses) for _ in range(2))
    np.testing.assert_array_equal(first.stack.radiance, second.stack.radiance)


def test_the_light_of_independent_pixels_stands_at_the_angle_asked_for() -> None:
    stack = independent(4, 10, 0.0, seed=1, theta_d_deg=3.0).stack
    cosine = np.sum(stack.camera_position * stack.light_position, axis=1) / 1e8
    assert np.rad2deg(np.arccos(cosine)) / 2 == pytest.approx(3.0)


def test_normals_are_drawn_from_the_ring_asked_for() -> None:
    tilt = np.rad2deg(np.arccos(independent(200, 4, 0.0, 1, narrowest_normal_deg=45.0, widest_normal_deg=65.0).normals))
    assert 45.0 <= tilt[:, 2].min() < tilt[:, 2].max() <= 65.0


def test_the_first_pixels_are_those_of_the_whole_scene() -> None:
    scene = independent(20, 6, 0.01, seed=2)
    part = scene.first(5)
    np.testing.assert_array_equal(part.stack.radiance, scene.stack.radiance[:, :, :5])
    np.testing.assert_array_equal(part.normals, scene.normals[:5])
    theta_h = np.full((5, 1), 0.3)
    np.testing.assert_array_equal(part.curve(theta_h), scene.curve(np.full((20, 1), 0.3))[:5])


def test_a_mixed_pixel_has_the_mean_curve_of_its_materials() -> None:
    scene = independent(6, 6, 0.0, seed=2, mixed=True)
    theta_h = np.array([0.1, 0.5])
    expected = np.einsum("pk,ktc->ptc", scene.weight, scene.material_curves(theta_h))
    assert scene.curve(np.broadcast_to(theta_h, (6, 2))) == pytest.approx(expected)


def test_a_plane_is_flat() -> None:
    assert relief(8, 4, 0.0, seed=0, steepness=0.0).normals == pytest.approx(np.broadcast_to([0.0, 0.0, 1.0], (64, 3)))


def test_clipped_samples_are_marked_and_bound() -> None:
    scene = clipped(independent(50, 20, 0.0, seed=3), 2.0)
    assert scene.stack.saturated is not None
    level = scene.stack.radiance.max()
    assert 0.0 < scene.stack.saturated.mean() < 0.5
    np.testing.assert_array_equal(scene.stack.radiance[scene.stack.saturated == 1], level)


def test_a_share_of_the_samples_is_spoilt_in_all_channels() -> None:
    scene = independent(100, 40, 0.0, seed=3)
    ratio = spoilt(scene, 0.1, np.random.default_rng(0)).stack.radiance / scene.stack.radiance
    changed = np.abs(ratio - 1.0) > 0.5
    assert changed.any(axis=-1).mean() == pytest.approx(0.1, abs=0.02)
    np.testing.assert_array_equal(changed.any(axis=-1), changed.all(axis=-1))


def test_gain_errors_scale_whole_views() -> None:
    scene = independent(10, 30, 0.0, seed=3)
    ratio = with_gain_errors(scene, 0.05, np.random.default_rng(0)).stack.radiance / scene.stack.radiance
    gain = ratio[:, 0, 0, 0]
    assert ratio == pytest.approx(np.broadcast_to(gain[:, None, None, None], ratio.shape), rel=1e-6)
    assert 0.03 < gain.std() < 0.07


def test_a_wrong_distance_moves_camera_and_light() -> None:
    scene = relief(8, 6, 0.0, seed=1)
    moved = at_wrong_distance(scene, 1.05).stack
    assert moved.camera_position == pytest.approx(1.05 * scene.stack.camera_position)
    assert moved.light_position == pytest.approx(1.05 * scene.stack.light_position)
