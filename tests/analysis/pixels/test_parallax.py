from dataclasses import replace

import numpy as np
import pytest

from analysis.pixels.parallax import follow_pixels, parallax_shift
from analysis.pixels.problem import samples_of
from analysis.reconstruction.effects import depth_has_settled
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import Reconstruction, reconstruct
from analysis.registration.stack import Stack
from tests.synthetic import make_stack


@pytest.fixture(scope="module")
def on_plane() -> Stack:
    return make_stack(n_views=40, size=24, registered_to="plane")


def from_above(picture: np.ndarray, camera: tuple[float, float, float]) -> Stack:
    """Return a stack of one view, pixels of 1 mm."""
    radiance = picture[None, :, :, None].astype(np.float32)
    position = np.array([camera])
    return Stack(radiance, position, position, 1.0, np.ones(1), variance=np.full_like(radiance, 4.0))


def follow_surface(stack: Stack, depth: np.ndarray) -> Stack:
    """Return the stack with all its pixels resampled."""
    samples = follow_pixels(stack, depth, np.arange(depth.size))
    shape = stack.radiance.shape
    radiance, variance, saturated = (a.reshape(shape) for a in samples)
    return replace(stack, radiance=radiance, variance=variance, saturated=saturated)


def difference(a: Stack, b: Stack) -> float:
    """Return the typical relative difference of radiances; the few at borders of materials do not count."""
    return float(np.nanmedian(np.abs(a.radiance / b.radiance - 1.0)))


def test_following_the_true_surface_turns_a_plane_stack_into_a_surface_stack(on_plane: Stack, stack: Stack):
    followed = follow_surface(on_plane, on_plane.truth.depth)
    assert difference(followed, stack) < 0.5 * difference(on_plane, stack)
    assert difference(followed, stack) < 0.01


def test_following_the_opposite_surface_makes_it_worse(on_plane: Stack, stack: Stack):
    assert difference(follow_surface(on_plane, -on_plane.truth.depth), stack) > difference(on_plane, stack)


def test_a_point_above_the_plane_is_seen_away_from_the_camera():
    """The line of sight from 45 degrees on the right meets the plane to the left of the point, by its height."""
    shift = parallax_shift(from_above(np.zeros((1, 1)), (1e6, 0.0, 1e6)), np.ones((1, 1)))
    np.testing.assert_allclose(shift[0, 0], [-1.0, 0.0], atol=1e-5)
    shift = parallax_shift(from_above(np.zeros((1, 1)), (0.0, 1e6, 1e6)), np.ones((1, 1)))
    np.testing.assert_allclose(shift[0, 0], [0.0, 1.0], atol=1e-5)


def test_a_shift_by_whole_pixels_copies_samples_exactly():
    picture = np.random.default_rng(0).random((12, 15))
    depth = np.full((12, 15), 2.0)
    stack = from_above(picture, (-1e9, 0.0, 1e9))
    followed = follow_surface(stack, depth)
    np.testing.assert_allclose(followed.radiance[0, :, :-2, 0], picture[:, 2:].astype(np.float32), rtol=1e-5)
    np.testing.assert_allclose(followed.variance[0, :, :-2, 0], 4.0, rtol=1e-5)
    assert np.isnan(followed.radiance[0, :, -2:, 0]).all()


def test_no_depth_changes_nothing(stack: Stack):
    flat = follow_surface(stack, np.full((24, 24), np.nan))
    np.testing.assert_array_equal(flat.radiance, stack.radiance)
    np.testing.assert_array_equal(flat.variance, stack.variance)


def test_a_smooth_picture_is_interpolated_to_a_thousandth():
    x, y = np.meshgrid(np.arange(40.0), np.arange(30.0))

    def wave(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return 2.0 + np.sin(0.35 * x) * np.cos(0.3 * y)

    followed = follow_surface(from_above(wave(x, y), (-1e9, 0.0, 1e9)), np.full((30, 40), 0.37))
    inner = (slice(2, -2), slice(2, -3))
    np.testing.assert_allclose(followed.radiance[0, ..., 0][inner], wave(x + 0.37, y)[inner], atol=2e-3)


def test_missing_are_the_samples_whose_line_of_sight_leaves_the_area(on_plane: Stack):
    depth = on_plane.truth.depth + 0.5
    followed = follow_surface(on_plane, depth)
    shift = parallax_shift(on_plane, depth).reshape(-1, 24, 24, 2)
    i, j = np.mgrid[:24, :24]
    x, y = j + shift[..., 0], i + shift[..., 1]
    outside = (x < -0.5) | (x > 23.5) | (y < -0.5) | (y > 23.5)
    np.testing.assert_array_equal(np.isnan(followed.radiance[..., 0]), outside)
    assert outside.any()


def test_variance_stays_positive_and_is_lowered_by_interpolation(on_plane: Stack):
    followed = follow_surface(on_plane, on_plane.truth.depth)
    assert np.nanmin(followed.variance) > 0.0
    halfway = follow_surface(from_above(np.zeros((8, 12)), (-1e9, 0.0, 1e9)), np.full((8, 12), 0.5))
    np.testing.assert_allclose(halfway.variance[0, :, 2:-3, 0], 4.0 * (2 * 0.5625**2 + 2 * 0.0625**2), rtol=1e-4)


def test_a_value_made_of_a_clipped_sample_is_a_bound_too():
    stack = from_above(np.ones((5, 9)), (-1e9, 0.0, 1e9))
    saturated = np.zeros(stack.radiance.shape, np.uint8)
    saturated[0, 2, 4] = 1
    followed = follow_surface(replace(stack, saturated=saturated), np.full((5, 9), 0.5))
    assert np.flatnonzero(followed.saturated[0, 2, :, 0]).tolist() == [2, 3, 4, 5]
    assert not followed.saturated[0, [0, 1, 3, 4]].any()


def test_a_bright_clipped_sample_marks_values_that_it_hardly_weighs_in():
    picture = np.ones((5, 9))
    picture[2, 4] = 100.0
    saturated = np.zeros((1, 5, 9, 1), np.uint8)
    saturated[0, 2, 4] = 1
    stack = replace(from_above(picture, (-1e9, 0.0, 1e9)), saturated=saturated)
    followed = follow_surface(stack, np.full((5, 9), 0.02))
    moved = np.abs(followed.radiance[0, 2, :, 0] - 1.0) > 0.03
    assert np.flatnonzero(moved).tolist() == [3, 4, 5]
    assert followed.saturated[0, 2, moved].all()


def test_a_missing_sample_makes_no_more_missing_than_it_must():
    picture = np.ones((5, 9))
    picture[2, 4] = np.nan
    stack = from_above(picture, (-1e9, 0.0, 1e9))
    flat, half = (follow_surface(stack, np.full((5, 9), z)).radiance[0, ..., 0] for z in (0.0, 0.5))
    assert np.flatnonzero(np.isnan(flat)).tolist() == [2 * 9 + 4]
    assert np.flatnonzero(np.isnan(half[2, :-1])).tolist() == [2, 3, 4, 5]


def test_a_stack_that_follows_a_depth_gives_its_samples_so(on_plane: Stack):
    depth, pixels = on_plane.truth.depth, np.array([3, 77, 401])
    some, every = samples_of(replace(on_plane, followed=depth), pixels), follow_surface(on_plane, depth)
    np.testing.assert_array_equal(some.radiance, every.radiance.reshape(on_plane.n_views, -1, 3)[:, pixels])
    np.testing.assert_array_equal(some.variance, every.variance.reshape(on_plane.n_views, -1, 3)[:, pixels])


def test_a_stack_without_variance_or_mask_gives_none(on_plane: Stack):
    bare = follow_pixels(replace(on_plane, variance=None), on_plane.truth.depth, np.arange(9))
    assert not bare.variance.any()
    assert not bare.saturated.any()


def chosen(stack: Stack, **options: object):
    result = reconstruct(stack, Options(**options))
    return result, {choice.effect: choice for choice in result.choices}["parallax"]


@pytest.mark.slow
def test_parallax_is_turned_on_for_a_stack_made_on_the_plane():
    on_plane = make_stack(n_views=40, size=32, pitch=0.2, registered_to="plane")
    result, choice = chosen(on_plane)
    assert choice.chosen == "on"
    assert "along the depth" in choice.reason
    assert result.stack.followed is not None
    assert "move the views by" in next(c.reason for c in result.choices if c.effect == "depth updates")


def test_parallax_is_turned_off_for_a_stack_made_on_the_surface(reconstruction: Reconstruction):
    choice = {choice.effect: choice for choice in reconstruction.choices}["parallax"]
    assert choice.chosen == "off"
    assert reconstruction.stack.followed is None


@pytest.mark.slow
def test_parallax_can_be_forced_and_says_so(stack: Stack):
    result, choice = chosen(stack, parallax="on")
    assert (choice.chosen, choice.reason) == ("on", "forced by option")
    assert result.stack.followed is not None


def test_the_geometry_is_updated_until_another_update_would_move_nothing(stack: Stack):
    used = np.zeros((24, 24))
    first = depth_has_settled(stack, used, used + 0.01, False, 1)
    settled, text = first.value, first.choice.reason
    assert settled
    assert text == f"another would turn directions by {np.rad2deg(0.01 / nearest(stack)):.2g} deg"
    assert not depth_has_settled(stack, used, used + 1.0, False, 1).value


def test_where_the_views_follow_the_depth_a_shift_of_theirs_asks_for_another_update(stack: Stack):
    used, found = np.zeros((24, 24)), np.full((24, 24), 0.2 * stack.pixel_pitch)
    fine = replace(stack, pixel_pitch=0.01)
    assert depth_has_settled(fine, used, found, False, 1).value
    followed = depth_has_settled(fine, used, found, True, 1)
    settled, text = followed.value, followed.choice.reason
    assert not settled
    assert "move the views by" in text


def nearest(stack: Stack) -> float:
    return float(np.linalg.norm(stack.light_position, axis=1).min())
