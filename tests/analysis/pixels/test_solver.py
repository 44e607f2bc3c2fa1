from dataclasses import replace

import numpy as np
import pytest

from analysis.evaluation.metrics import angular_error_deg
from analysis.pixels.fits import PixelFits
from analysis.pixels.problem import Noise, PixelProblem, estimate_noise
from analysis.pixels.samples import BLACK, CLIPPED, POOR_FIT, TOO_FEW_VIEWS
from analysis.reflectance.dictionary import parametric
from analysis.reflectance.models import Cosines
from analysis.registration.stack import Stack
from benchmarks.common.scenes import independent
from tests.analysis.conftest import NOISE, solve
from tests.synthetic import make_stack, with_views


@pytest.fixture(scope="module")
def clean() -> Stack:
    """The same sample seen almost without noise."""
    return make_stack(n_views=40, size=24, noise=1e-4, floor=1e-5)


def error_deg(fits: PixelFits, stack: Stack) -> np.ndarray:
    return angular_error_deg(fits.normals, stack.truth.normals.reshape(-1, 3))


def between_deg(a: PixelFits, b: PixelFits) -> np.ndarray:
    return angular_error_deg(a.normals, b.normals)


def damaged(stack: Stack, where: np.ndarray, factor: float) -> Stack:
    """Return the stack with samples (view, row, column) times `factor`, their stated variance unchanged."""
    return replace(stack, radiance=np.where(where[..., None], np.float32(factor) * stack.radiance, stack.radiance))


def test_normals_come_within_a_fifth_of_a_degree_at_half_a_percent_of_noise(fits: PixelFits, stack: Stack):
    error = error_deg(fits, stack)
    assert error.mean() < 0.2
    assert np.percentile(error, 95) < 0.5
    np.testing.assert_allclose(np.linalg.norm(fits.normals, axis=1), 1.0, rtol=1e-12)


def test_the_residuals_are_what_the_noise_says(fits: PixelFits):
    assert 0.7 < np.median(fits.reduced_chi2) < 1.3
    assert not (fits.flags & POOR_FIT).any()


def test_the_fitted_curve_is_the_true_reflectance_where_it_was_seen(fits: PixelFits, stack: Stack):
    """The matte stripe is Lambertian with albedo 0.5, 0.3, 0.2."""
    matte = np.flatnonzero(stack.truth.material.ravel() == 0)
    theta = np.broadcast_to(np.deg2rad([20.0, 35.0, 50.0]), (len(matte), 3))
    curve = fits.select(matte).brdf(Cosines.on_slice(theta))
    np.testing.assert_allclose(np.median(curve, axis=0) * np.pi, np.full((3, 3), [0.5, 0.3, 0.2]), rtol=0.01)


def test_the_units_of_radiance_do_not_matter(fits: PixelFits, stack: Stack):
    scaled = replace(stack, radiance=1e3 * stack.radiance, variance=1e6 * stack.variance)
    other = solve(replace(scaled, radiance=scaled.radiance.astype(np.float32), variance=scaled.variance))
    assert np.percentile(between_deg(fits, other), 99) < 1e-3
    np.testing.assert_allclose(
        np.median(other.coefficient.sum(axis=(1, 2)) / fits.coefficient.sum(axis=(1, 2))), 1e3, rtol=1e-3
    )


def test_the_unit_of_length_does_not_matter(fits: PixelFits, stack: Stack):
    half = replace(
        stack,
        camera_position=0.5 * stack.camera_position,
        light_position=0.5 * stack.light_position,
        pixel_pitch=0.5 * stack.pixel_pitch,
    )
    assert np.percentile(between_deg(fits, solve(half)), 99) < 1e-3


def test_the_power_of_the_light_divides_out(fits: PixelFits, stack: Stack):
    power = np.random.default_rng(0).uniform(0.5, 2.0, stack.n_views)
    gain = power[:, None, None, None].astype(np.float32)
    brighter = replace(stack, radiance=gain * stack.radiance, variance=gain**2 * stack.variance, light_power=power)
    assert np.percentile(between_deg(fits, solve(brighter)), 99) < 1e-3


def test_the_order_of_the_views_does_not_matter(fits: PixelFits, stack: Stack):
    shuffled = with_views(stack, np.random.default_rng(0).permutation(stack.n_views))
    assert np.percentile(between_deg(fits, solve(shuffled)), 95) < 1e-3


def test_turning_the_sample_under_the_rig_turns_the_normals(fits: PixelFits, stack: Stack):
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    turned = replace(
        stack, camera_position=stack.camera_position @ turn.T, light_position=stack.light_position @ turn.T
    )
    problem = PixelProblem(turned, parametric())
    problem.points = problem.points @ turn.T
    other = problem.solve(NOISE)
    assert np.percentile(angular_error_deg(other.normals, fits.normals @ turn.T), 95) < 1e-3


def test_one_thread_and_two_give_the_same_bits(stack: Stack):
    one, two = (solve(stack, threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.normals, two.normals)
    np.testing.assert_array_equal(one.coefficient, two.coefficient)
    np.testing.assert_array_equal(one.covariance, two.covariance)


def test_a_part_of_the_pixels_gives_the_same_bits_as_all(fits: PixelFits, stack: Stack):
    pixels = np.arange(7, 576, 5)
    part = solve(stack, pixels)
    np.testing.assert_array_equal(part.normals, fits.normals[pixels])
    np.testing.assert_array_equal(part.coefficient, fits.coefficient[pixels])


def test_a_view_that_does_not_see_a_pixel_is_as_if_it_were_not_there(stack: Stack):
    radiance = stack.radiance.copy()
    radiance[[3, 11, 30]] = np.nan
    without = with_views(stack, np.delete(np.arange(40), [3, 11, 30]))
    difference = between_deg(solve(replace(stack, radiance=radiance)), solve(without))
    assert np.percentile(difference, 95) < 1e-3


def test_a_view_without_light_power_is_as_if_it_were_not_there(stack: Stack):
    difference = between_deg(solve(stack.without_view(11)), solve(with_views(stack, np.delete(np.arange(40), 11))))
    assert np.percentile(difference, 95) < 1e-3


def test_scattered_missing_samples_cost_little(stack: Stack):
    radiance = stack.radiance.copy()
    radiance[np.random.default_rng(0).random(radiance.shape) < 0.2] = np.nan
    assert error_deg(solve(replace(stack, radiance=radiance)), stack).mean() < 0.25


def test_a_pixel_that_no_view_sees_is_flagged_and_has_no_normal(fits: PixelFits, stack: Stack):
    radiance = stack.radiance.copy()
    radiance[:, 2, 5] = np.nan
    blind = solve(replace(stack, radiance=radiance))
    i = 2 * 24 + 5
    assert blind.flags[i] & TOO_FEW_VIEWS
    assert np.isnan(blind.normals[i]).all()
    assert np.isnan(blind.theta_h_range[i]).all()
    assert (blind.atom[i] == -1).all()
    others = np.delete(np.arange(576), i)
    np.testing.assert_array_equal(blind.normals[others], fits.normals[others])


def test_a_pixel_seen_by_three_views_is_flagged(stack: Stack):
    radiance = stack.radiance.copy()
    radiance[3:] = np.nan
    fit = solve(replace(stack, radiance=radiance), np.array([0]))
    assert fit.flags[0] & TOO_FEW_VIEWS


def test_a_black_pixel_is_flagged_and_has_no_normal(stack: Stack):
    radiance = stack.radiance.copy()
    radiance[:, 4, 4] = 0.0
    fit = solve(replace(stack, radiance=radiance), np.array([4 * 24 + 4]))
    assert fit.flags[0] & BLACK
    assert np.isnan(fit.normals).all()


def test_pixels_of_black_next_to_nan_do_not_disturb_each_other(stack: Stack):
    radiance = stack.radiance.copy()
    radiance[:, 4, 4], radiance[:, 4, 5] = 0.0, np.nan
    fit = solve(replace(stack, radiance=radiance))
    assert np.flatnonzero(np.isnan(fit.normals[:, 0])).tolist() == [4 * 24 + 4, 4 * 24 + 5]


@pytest.fixture(scope="module")
def clipped(stack: Stack) -> Stack:
    """Every pixel's samples above two thirds of its brightest view are clipped."""
    bound = 0.67 * stack.radiance.max(axis=0)
    return replace(
        stack,
        radiance=np.minimum(stack.radiance, bound),
        saturated=(stack.radiance > bound).astype(np.uint8),
    )


def test_clipped_highlights_are_bounds_and_the_normals_stay_good(clipped: Stack):
    fit = solve(clipped)
    error = error_deg(fit, clipped)
    assert (fit.flags & CLIPPED).all()
    assert error.mean() < 0.3


def test_a_bound_is_better_than_a_value_that_is_not_true(clipped: Stack):
    believed = solve(replace(clipped, saturated=None))
    glossy = clipped.truth.material.ravel() > 0
    assert error_deg(solve(clipped), clipped)[glossy].mean() < 0.5 * error_deg(believed, clipped)[glossy].mean()


def test_a_part_of_clipped_pixels_gives_the_same_bits_as_all(clipped: Stack):
    pixels = np.arange(7, 576, 5)
    np.testing.assert_array_equal(solve(clipped, pixels).normals, solve(clipped).normals[pixels])


def test_a_pixel_of_which_most_views_are_clipped_is_told_from_the_others():
    scene = independent(300, 65, 0.01, 5)
    radiance = scene.stack.radiance
    bound = np.quantile(radiance, 0.3, axis=0)
    stack = replace(
        scene.stack, radiance=np.minimum(radiance, bound), saturated=(radiance > bound).astype(np.uint8)
    ).without_view(3)
    error = angular_error_deg(solve(stack).normals, scene.normals)
    assert np.median(error) < 0.5
    assert np.mean(error > 5.0) < 0.03


def test_steep_normals_are_found_though_no_likely_start_leads_there():
    scene = independent(300, 65, 0.02, 5, narrowest_normal_deg=45.0, widest_normal_deg=65.0)
    error = angular_error_deg(solve(scene.stack).normals, scene.normals)
    assert np.mean(error > 5.0) < 0.01


def test_a_pixel_clipped_in_every_view_is_flagged_and_has_no_normal(stack: Stack):
    saturated = np.zeros(stack.radiance.shape, np.uint8)
    saturated[:, 1, 1] = 1
    fit = solve(replace(stack, saturated=saturated))
    assert fit.flags[25] & CLIPPED
    assert fit.flags[25] & TOO_FEW_VIEWS
    assert np.isnan(fit.normals[25]).all()
    assert not (np.delete(fit.flags, 25) & CLIPPED).any()


@pytest.mark.parametrize("factor", [0.0, 0.5, 1.5])
def test_five_percent_of_wrong_views_barely_move_the_normals(fits: PixelFits, stack: Stack, factor: float):
    where = np.random.default_rng(1).random(stack.radiance.shape[:3]) < 0.05
    wrong = damaged(stack, where, factor)
    robust, plain = error_deg(solve(wrong), stack), error_deg(solve(wrong, robust=False), stack)
    assert np.median(robust) < 2.5 * np.median(error_deg(fits, stack))
    assert robust.mean() < 0.3
    assert robust.mean() < 0.2 * plain.mean()


def test_the_stated_sigma_holds_its_coverage(fits: PixelFits, stack: Stack):
    ratio = error_deg(fits, stack) / np.rad2deg(fits.normal_sigma)
    assert 0.5 < np.mean(ratio < 1.5096) < 0.85
    assert np.mean(ratio < 2.4477) > 0.8


@pytest.mark.parametrize("pixel", [(12, 3), (12, 12), (12, 20)])
def test_the_stated_covariance_is_the_scatter_over_draws_of_the_noise(clean: Stack, pixel: tuple[int, int]):
    n_draws = 250
    samples = clean.radiance[:, pixel[0], pixel[1]][:, None, None]
    sigma = 0.005 * samples
    noise = np.random.default_rng(2).standard_normal((clean.n_views, 1, n_draws, 3))
    draws = replace(
        clean,
        radiance=(samples + sigma * noise).astype(np.float32),
        variance=np.broadcast_to(sigma**2, noise.shape).astype(np.float32),
        truth=None,
    )
    problem = PixelProblem(draws, parametric())
    problem.points = np.tile(clean.grid.points()[pixel], (n_draws, 1))
    fit = problem.solve(Noise(1e-5, 0.0))
    scatter = np.sqrt(np.sum(np.var(fit.normals, axis=0)) / 2.0)
    assert np.median(fit.normal_sigma) == pytest.approx(scatter, rel=0.5)


def test_without_noise_the_normals_are_exact(clean: Stack):
    """What is left is how far the dictionary is from the materials."""
    fit = PixelProblem(clean, parametric(), depth=clean.truth.depth).solve(Noise(1e-4, 0.0))
    assert np.median(error_deg(fit, clean)) < 0.02


def test_a_normal_to_go_on_from_leads_to_the_same_end(fits: PixelFits, stack: Stack):
    again = solve(stack, start=fits.normals)
    moved = between_deg(fits, again) / np.rad2deg(fits.normal_sigma)
    assert np.median(moved) < 1.0
    assert error_deg(again, stack).mean() < 1.1 * error_deg(fits, stack).mean()


def test_the_half_angles_seen_are_those_of_the_geometry(fits: PixelFits, stack: Stack):
    to_camera = stack.camera_position[:, None] - stack.grid.points().reshape(-1, 3)
    to_camera /= np.linalg.norm(to_camera, axis=-1, keepdims=True)
    theta = np.arccos(np.sum(to_camera * fits.normals, axis=-1))
    np.testing.assert_allclose(fits.theta_h_range, np.stack([theta.min(axis=0), theta.max(axis=0)], axis=1), atol=1e-6)


def test_the_noise_level_is_found_from_the_residuals():
    """The stated variance is zero, so the one percent must come from the residuals."""
    silent = make_stack(n_views=40, size=24, noise=0.01, floor=0.0)
    silent = replace(silent, variance=np.zeros_like(silent.variance))
    noise = estimate_noise(silent, parametric(), np.random.default_rng(0))
    assert noise.relative == pytest.approx(0.01, rel=0.15)


def test_wrong_samples_do_not_pass_for_noise(stack: Stack):
    where = np.random.default_rng(1).random(stack.radiance.shape[:3]) < 0.05
    clean, wrong = (
        estimate_noise(s, parametric(), np.random.default_rng(0)) for s in (stack, damaged(stack, where, 0.5))
    )
    assert wrong.relative < clean.relative + 0.005


def test_a_variance_that_says_it_all_leaves_little_to_add(stack: Stack):
    assert estimate_noise(stack, parametric(), np.random.default_rng(0)).relative < 0.002


def test_the_prediction_of_a_view_is_what_was_measured(fits: PixelFits, stack: Stack):
    points = stack.grid.points().reshape(-1, 3)
    predicted = fits.radiance(points, stack.camera_position[5], stack.light_position[5])
    measured = stack.radiance[5].reshape(-1, 3)
    assert np.sqrt(np.mean((predicted / measured - 1.0) ** 2)) < 0.01


def test_one_channel_will_do(stack: Stack):
    grey = replace(stack, radiance=stack.radiance[..., 1:2].copy(), variance=stack.variance[..., 1:2].copy())
    assert error_deg(solve(grey), stack).mean() < 0.3
