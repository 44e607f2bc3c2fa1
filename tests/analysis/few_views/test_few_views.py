from dataclasses import replace

import numpy as np
import pytest

from analysis.evaluation.metrics import angular_error_deg
from analysis.few_views.method import FewViews, solve_few_views
from analysis.few_views.solution import fits_of, materials_of
from analysis.pixels.problem import PixelProblem, estimate_noise
from analysis.reflectance.dictionary import parametric
from tests.analysis.few_views.phone import OFFSET_MM, Phone, phone


@pytest.fixture(scope="module")
def taken() -> Phone:
    return phone()


@pytest.fixture(scope="module")
def few(taken: Phone) -> FewViews:
    return solve_few_views(taken.stack, find_light=True)


def test_powers_that_nobody_stated_are_found(taken: Phone, few: FewViews):
    off = few.log_power - taken.log_power
    assert np.std(taken.log_power) > 0.08
    assert np.std(off) < 0.03


def test_the_torch_is_found_within_its_sigma(few: FewViews):
    assert few.offset is not None
    off = few.offset.value[:2] - [OFFSET_MM, 0.0]
    assert np.all(np.abs(off) < 2.0 * few.offset.sigma[:2])
    assert np.linalg.norm(off) < 5.0
    # The sigma has the plane's error in it, not the scatter alone.
    assert np.all(few.offset.sigma[:2] > 2.0)


def test_the_mean_normal_is_that_of_the_plane(few: FewViews):
    mean = few.state.normals().mean(axis=0)
    assert np.rad2deg(np.arccos(mean[2] / np.linalg.norm(mean))) < 0.3


def test_normals_are_better_than_those_of_pixels_on_their_own(taken: Phone, few: FewViews):
    rng = np.random.default_rng(0)
    noise = estimate_noise(taken.stack, parametric(), rng)
    alone = PixelProblem(few.stack, parametric()).solve(noise)
    ours, theirs = (angular_error_deg(n, taken.normals) for n in (few.state.normals(), alone.normals))
    assert ours.mean() < 0.7 * np.nanmean(theirs)


def test_a_result_renders_what_was_solved(taken: Phone, few: FewViews):
    """As fits, with materials over all angles: nothing is lost on the way to a renderer."""
    fits = fits_of(few)
    fits = replace(fits, dictionary=materials_of(few, fits).dictionary(fits.dictionary))
    points = few.stack.grid.points().reshape(-1, 3)
    for v in range(few.stack.n_views):
        power = float(few.stack.light_power[v])
        told = fits.radiance(points, few.stack.camera_position[v], few.stack.light_position[v], power)
        seen = np.asarray(taken.stack.radiance[v]).reshape(told.shape)
        free = np.asarray(taken.stack.saturated[v]).reshape(told.shape) == 0
        assert np.sqrt(np.sum((told - seen)[free] ** 2) / np.sum(seen[free] ** 2)) < 0.12
        # No sparkle that no photograph has.
        assert np.nanmax(told) < 6.0 * seen.max()


def test_materials_are_bounded_where_no_view_has_seen_them(few: FewViews):
    """On the slice that views see; far off it a highlight at grazing light is a hundred times as bright by nature."""
    materials = materials_of(few, fits_of(few))
    near = materials.theta_d <= np.deg2rad(45.0)
    for k, (low, high) in enumerate(materials.seen):
        inside = (materials.theta_h >= low) & (materials.theta_h <= high)
        for atom in materials.atoms[3 * k : 3 * k + 3]:
            seen = atom.value[inside, 0].max()
            assert atom.value[:, 0].max() < 6.0 * seen
            assert atom.value[:, near].max() < 20.0 * seen


def test_the_number_of_threads_does_not_change_a_bit():
    stack = phone(32).stack
    one, two = (solve_few_views(stack, threads=n) for n in (1, 2))
    np.testing.assert_array_equal(one.state.field.slope, two.state.field.slope)
    np.testing.assert_array_equal(one.log_power, two.log_power)


def test_the_order_of_the_views_does_not_matter(taken: Phone, few: FewViews):
    order = np.array([3, 0, 6, 1, 5, 2, 4])
    stack = taken.stack
    names = ("radiance", "variance", "saturated", "camera_position", "light_position", "light_power", "camera_rotation")
    turned = replace(stack, **{name: getattr(stack, name)[order] for name in names})
    again = solve_few_views(turned, find_light=True)
    np.testing.assert_allclose(again.log_power, few.log_power[order], atol=0.02)
    assert np.median(angular_error_deg(again.state.normals(), few.state.normals())) < 0.3


def test_a_large_area_is_solved_with_what_was_learnt_from_its_binned_pixels(taken: Phone):
    whole, binned = (solve_few_views(taken.stack, most_pixels=n) for n in (64**2, 32**2))
    assert binned.state.normals().shape == whole.state.normals().shape
    worse = [angular_error_deg(few.state.normals(), taken.normals).mean() for few in (binned, whole)]
    assert worse[0] < 1.5 * worse[1]


def test_a_pixel_that_no_view_sees_is_a_hole(taken: Phone):
    radiance = taken.stack.radiance[:, :32, :32].copy()
    radiance[:, 3, 4] = np.nan
    radiance[:5, 5, 6] = np.nan
    stack = replace(
        taken.stack,
        radiance=radiance,
        variance=taken.stack.variance[:, :32, :32],
        saturated=taken.stack.saturated[:, :32, :32],
    )
    fits = fits_of(solve_few_views(stack))
    solved = np.isfinite(fits.normals[:, 0])
    assert not solved[3 * 32 + 4]
    assert not solved[5 * 32 + 6]
    assert solved.sum() == 32 * 32 - 2


def test_one_channel_is_solved_too(taken: Phone):
    stack = taken.stack
    grey = replace(
        stack, radiance=stack.radiance[..., 1:2], variance=stack.variance[..., 1:2], saturated=stack.saturated[..., 1:2]
    )
    few = solve_few_views(grey)
    assert np.std(few.log_power - taken.log_power) < 0.05
