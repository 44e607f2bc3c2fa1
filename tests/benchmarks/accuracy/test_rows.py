"""Scores of an estimate: errors, coverage, curves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from benchmarks.accuracy.rows import (
    INSIDE_68,
    INSIDE_95,
    MAX_HALF_ANGLE,
    N_ANGLES,
    coverage,
    curve_error,
    error_figures,
    paired,
    score,
    seen_half_angles,
)
from benchmarks.common.methods import Estimate, known, lambert, trimmed
from benchmarks.common.scenes import Scene, independent, relief


@pytest.fixture(scope="module")
def scene() -> Scene:
    return independent(60, 20, 0.01, seed=5)


def estimate_of(scene: Scene, factor: float = 1.0) -> Estimate:
    """The truth, curves times a factor."""
    n = len(scene.normals)
    return Estimate(scene.normals, np.full(n, 0.01), lambda theta_h: factor * scene.curve(theta_h), 2.0, 3.0)


@pytest.mark.parametrize(("worse", "expected"), [(1.0, (0.68, 0.95)), (2.0, (0.248, 0.527)), (0.5, (0.99, 1.0))])
def test_gaussian_errors_are_covered_as_often_as_their_sigma_says(worse: float, expected: tuple[float, float]) -> None:
    rng = np.random.default_rng(2)
    sigma = rng.uniform(0.001, 0.01, 40_000)
    error = np.rad2deg(np.hypot(*(worse * sigma * rng.standard_normal((2, sigma.size)))))
    inside = coverage(error, sigma)
    assert (inside["coverage68"], inside["coverage95"]) == pytest.approx(expected, abs=0.01)


def test_the_thresholds_are_those_of_a_two_dimensional_gaussian() -> None:
    assert 1.0 - np.exp(-0.5 * np.array([INSIDE_68, INSIDE_95]) ** 2) == pytest.approx([0.68, 0.95], abs=1e-4)


def test_a_method_that_states_no_sigma_has_no_coverage(scene: Scene) -> None:
    row = score(scene, lambert(scene))
    assert np.isnan([row["coverage68"], row["coverage95"]]).all()


def test_the_true_curve_has_no_error(scene: Scene) -> None:
    assert curve_error(scene, estimate_of(scene)) == pytest.approx(0.0, abs=1e-12)


def test_a_curve_ten_per_cent_too_high_has_an_error_of_ten_per_cent(scene: Scene) -> None:
    assert curve_error(scene, estimate_of(scene, 1.1)) == pytest.approx(0.1)


def test_a_pixel_that_was_not_solved_counts_as_far_off_and_for_nothing_else() -> None:
    figures = error_figures(np.array([1.0, 2.0, 3.0, np.nan]))
    assert figures["n_unsolved"] == 1
    assert figures["share_above_5deg"] == 0.25
    assert figures["mean_deg"] == pytest.approx(2.0)


def test_half_angles_are_spread_over_what_the_views_show(scene: Scene) -> None:
    theta_h = seen_half_angles(scene)
    assert theta_h.shape == (60, N_ANGLES)
    assert np.all(np.diff(theta_h, axis=1) >= 0.0)
    assert theta_h.max() < MAX_HALF_ANGLE
    cosine = scene.normals[0] @ scene.stack.camera_position.T / 1e4
    assert np.cos(theta_h[0, 0]) == pytest.approx(cosine.max(), abs=1e-6)


def test_a_row_states_speed_and_depth() -> None:
    near = relief(8, 10, 0.01, seed=1)
    assert near.stack.truth is not None
    row = score(near, replace(estimate_of(near), depth=near.stack.truth.depth + 3.0))
    assert row["pixels_per_s"] == pytest.approx(32.0)
    assert row["depth_rmse_mm"] == pytest.approx(0.0, abs=1e-12)
    assert row["mean_deg"] == pytest.approx(0.0, abs=1e-9)


def test_pairing_compares_the_very_same_pixels() -> None:
    found = paired(np.array([1.0, 2.0, 9.0, np.nan]), np.array([2.0, 1.0, 10.0, 1.0]))
    assert found["paired_n_pixels"] == 3
    assert found["paired_mean_deg"] == pytest.approx(4.0)
    assert found["paired_better_than_reference"] == pytest.approx(2 / 3)


def test_trimming_helps_on_highlights_and_knowing_everything_helps_most(scene: Scene) -> None:
    errors = [score(scene, method(scene))["mean_deg"] for method in (lambert, trimmed, known)]
    assert errors == sorted(errors, reverse=True)
