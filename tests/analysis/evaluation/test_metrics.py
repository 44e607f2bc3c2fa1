from dataclasses import astuple

import numpy as np
import pytest

from analysis.evaluation.metrics import (
    angular_error_deg,
    depth_rmse,
    depth_rmse_without_plane,
    error_summary,
    psnr_db,
    relative_rms,
)

X, Z = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])


def test_the_same_normals_have_no_error():
    assert angular_error_deg(Z, Z) == 0.0


def test_orthogonal_and_opposite_normals_are_90_and_180_degrees_apart():
    assert angular_error_deg(X, Z) == pytest.approx(90.0)
    assert angular_error_deg(Z, -Z) == pytest.approx(180.0)


@pytest.mark.parametrize("angle", [1e-9, 1e-6, 1e-3, 1.0])
def test_tiny_angles_keep_their_digits(angle: float):
    tilted = np.array([np.sin(np.deg2rad(angle)), 0.0, np.cos(np.deg2rad(angle))])
    assert angular_error_deg(tilted, Z) == pytest.approx(angle, rel=1e-6)


def test_the_error_of_a_missing_normal_is_missing():
    error = angular_error_deg(np.stack([Z, np.full(3, np.nan)]), np.stack([X, Z]))
    np.testing.assert_array_equal(np.isnan(error), [False, True])


def test_a_summary_leaves_missing_values_out():
    summary = error_summary(np.array([1.0, 2.0, 6.0, np.nan]))
    assert summary.mean == pytest.approx(3.0)
    assert summary.median == pytest.approx(2.0)
    assert 2.0 < summary.p95 <= 6.0


def test_a_summary_of_nothing_is_missing():
    assert np.isnan(astuple(error_summary(np.array([np.nan])))).all()


@pytest.fixture
def truth() -> np.ndarray:
    return np.random.default_rng(0).standard_normal((12, 9))


def test_depth_is_compared_without_its_mean(truth: np.ndarray):
    assert depth_rmse(truth + 5.0, truth) == pytest.approx(0.0, abs=1e-12)


def test_depth_error_is_the_root_mean_square_over_the_common_pixels(truth: np.ndarray):
    sign = np.where(np.indices(truth.shape).sum(axis=0) % 2, 0.1, -0.1)
    depth = truth + sign
    depth[0] = np.nan
    assert depth_rmse(depth, truth) == pytest.approx(0.1, rel=0.02)


def test_a_tilt_counts_as_depth_error_but_not_without_the_plane(truth: np.ndarray):
    rows, columns = np.indices(truth.shape)
    tilted = truth + 0.3 * rows - 0.2 * columns + 4.0
    assert depth_rmse(tilted, truth) > 0.5
    assert depth_rmse_without_plane(tilted, truth) == pytest.approx(0.0, abs=1e-9)


def test_no_common_pixel_has_no_depth_error(truth: np.ndarray):
    nothing = np.full_like(truth, np.nan)
    assert np.isnan(depth_rmse(nothing, truth))
    assert np.isnan(depth_rmse_without_plane(nothing, truth))


def test_relative_rms_is_a_share_of_the_measured_power():
    measured = np.array([3.0, 4.0, np.nan])
    assert relative_rms(1.1 * measured, measured) == pytest.approx(0.1)
    assert np.isnan(relative_rms(np.zeros(2), np.zeros(2)))


def test_psnr_is_twenty_decibels_a_factor_of_ten():
    measured = np.array([1.0, 0.5, np.nan])
    assert psnr_db(measured + 0.1, measured, 1.0) == pytest.approx(20.0)
    assert psnr_db(measured + 0.01, measured, 1.0) == pytest.approx(40.0)
    assert psnr_db(measured, measured, 1.0) == np.inf
    assert np.isnan(psnr_db(np.full(3, np.nan), measured, 1.0))
