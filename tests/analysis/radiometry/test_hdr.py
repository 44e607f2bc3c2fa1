import numpy as np
import pytest

from analysis.radiometry.hdr import Sensor, merge_bracket

SENSOR = Sensor(saturation_level=4095.0, conversion_gain=4.0, read_noise=6.0)
TIMES = np.array([0.002, 0.016, 0.128])
BLACK = 64.0
SHAPE = (150, 200)


def capture(radiance: float, rng: np.random.Generator, times=TIMES, sensor: Sensor = SENSOR) -> np.ndarray:
    """Return the counts of a bracket of an even picture of `radiance` DN/s: Poisson and read noise, clipped."""
    n_electrons = rng.poisson(radiance * sensor.conversion_gain * times[:, None, None], (len(times), *SHAPE))
    electrons = n_electrons + sensor.read_noise * rng.standard_normal(n_electrons.shape)
    counts = np.round(BLACK + electrons / sensor.conversion_gain)
    return np.clip(counts, 0, sensor.saturation_level).astype(np.uint16)


def dark(times=TIMES) -> np.ndarray:
    return np.full((len(times), *SHAPE), BLACK, np.float32)


def merge(counts: np.ndarray, times=TIMES):
    return merge_bracket(counts, times, dark(times), SENSOR)


@pytest.mark.parametrize("radiance", [500.0, 5e3, 2e4, 1e5, 1e6])
def test_the_merge_is_unbiased_and_states_its_variance(radiance: float):
    merged = merge(capture(radiance, np.random.default_rng(0)))
    mean, scatter = merged.mean.mean(dtype=np.float64), merged.mean.var(dtype=np.float64)
    assert mean == pytest.approx(radiance, abs=4.0 * np.sqrt(scatter / merged.mean.size) + 2e-4 * radiance)
    assert merged.variance.mean() == pytest.approx(scatter, rel=0.1)
    assert not merged.saturated.any()


def test_the_merge_is_no_noisier_than_counts_over_time_by_the_sum():
    """With much light, sum of counts over sum of times is the Poisson-optimal estimate."""
    counts = capture(2e4, np.random.default_rng(1))
    optimal = (counts - BLACK).sum(axis=0) / TIMES.sum()
    assert merge(counts).mean.std() < 1.02 * optimal.std()


@pytest.mark.parametrize("read_noise", [2.0, 15.0])
def test_the_error_is_within_two_percent_of_the_best_that_any_merge_can_reach(read_noise: float):
    """Cramer-Rao: the variance of an unbiased estimate is no less than 1 / sum (t^2 / variance of the counts)."""
    rng = np.random.default_rng(11)
    times, black, n = np.array([0.001, 0.004, 0.016, 0.064, 0.256]), 64.0, 600
    L = 10.0 ** rng.uniform(3.0, 6.0, (n, n))
    electrons = rng.poisson(4.0 * L * times[:, None, None]) + read_noise * rng.standard_normal((5, n, n))
    counts = np.clip(np.round(black + electrons / 4.0), 0, 4095).astype(np.uint16)
    merged = merge_bracket(counts, times, np.full((2, 2), black), Sensor(4095.0, 4.0, read_noise))
    t = times[:, None, None]
    unclipped = black + L * t < 4054.0
    information = np.where(unclipped, t**2 / (L * t / 4.0 + (read_noise / 4.0) ** 2 + 1.0 / 12.0), 0.0).sum(axis=0)
    error = merged.mean / L - 1.0
    assert np.sqrt(np.mean(error**2)) < 1.02 * np.sqrt(np.mean(1.0 / information / L**2))


def test_left_and_right_aligned_counts_give_the_same_radiance():
    counts = capture(2e4, np.random.default_rng(12))
    right = merge(counts)
    left = merge_bracket(16 * counts, TIMES, 16 * dark(), Sensor(16 * 4095.0, 4.0 / 16, 6.0, step=16.0))
    np.testing.assert_allclose(left.mean, 16 * right.mean, rtol=1e-6)
    np.testing.assert_allclose(left.variance, 256 * right.variance, rtol=1e-6)


def test_the_black_level_of_each_place_of_the_cell_is_that_of_a_dark_frame():
    cell = np.array([[60.0, 64.0], [66.0, 71.0]])
    counts = capture(2e4, np.random.default_rng(13))
    frames = np.tile(cell, (3, SHAPE[0] // 2, SHAPE[1] // 2)).astype(np.float32)
    one, other = (merge_bracket(counts, TIMES, black, SENSOR) for black in (cell, frames))
    np.testing.assert_array_equal(one.mean, other.mean)


def test_each_place_of_the_cell_clips_at_its_own_level():
    counts = np.full((2, *SHAPE), 3000, np.uint16)
    counts[0] = 900
    sensor = Sensor(np.array([[4095.0, 2900.0], [4095.0, 4095.0]]), 4.0, 6.0)
    valid = merge_bracket(counts, TIMES[:2], dark()[:2], sensor).valid
    assert (valid[0::2, 1::2] == 1).all()
    assert (valid[1::2] == 2).all()
    assert (valid[0::2, 0::2] == 2).all()


def test_pictures_with_channels_are_merged_channel_by_channel():
    counts = np.stack([capture(L, np.random.default_rng(14)) for L in (5e3, 2e4, 1e5)], axis=-1)
    together = merge_bracket(counts, TIMES, np.full(3, BLACK), SENSOR)
    for k in range(3):
        alone = merge(np.ascontiguousarray(counts[..., k]))
        np.testing.assert_array_equal(together.mean[..., k], alone.mean)
        np.testing.assert_array_equal(together.valid[..., k], alone.valid)


def test_linear_floating_point_pictures_are_taken_as_they_are():
    radiance = np.random.default_rng(15).uniform(0.01, 3.0, (4, 6, 3)).astype(np.float32)
    counts = radiance * TIMES[:, None, None, None].astype(np.float32)
    merged = merge_bracket(counts, TIMES, np.zeros(3), Sensor(np.inf, 1e6, 0.0, step=0.0))
    np.testing.assert_allclose(merged.mean, radiance, rtol=1e-5)
    assert (merged.valid == 3).all()


def test_what_is_not_a_number_stays_so_and_is_not_called_clipped():
    counts = np.full((3, 4, 6), 1000.0, np.float32)
    counts[:, 1, 2] = np.nan
    merged = merge_bracket(counts, TIMES, np.zeros((2, 2)), SENSOR)
    assert np.isnan(merged.mean[1, 2])
    assert not merged.saturated.any()
    assert np.isfinite(merged.mean).sum() == 23


def test_it_is_counted_how_many_exposures_did_not_clip():
    counts = capture(1e5, np.random.default_rng(16))
    counts[:, 5, 7] = 4095
    valid = merge(counts).valid
    assert valid[5, 7] == 0
    assert np.median(valid) == 2


def test_a_clipped_exposure_is_left_out():
    rng = np.random.default_rng(2)
    counts = capture(1e5, rng)
    assert np.all(counts[2] == 4095)
    merged, without = merge(counts), merge(counts[:2], TIMES[:2])
    np.testing.assert_array_equal(merged.mean, without.mean)
    np.testing.assert_array_equal(merged.variance, without.variance)


def test_counts_just_below_the_clipping_level_are_not_trusted():
    counts = np.full((2, *SHAPE), 4080, np.uint16)
    counts[0] = 1000
    merged = merge(counts, TIMES[:2])
    np.testing.assert_allclose(merged.mean, (1000 - BLACK) / TIMES[0], rtol=1e-5)


def test_a_pixel_clipped_in_every_exposure_is_a_lower_bound_and_says_so():
    counts = capture(1e4, np.random.default_rng(3))
    true_radiance = 1e7
    counts[:, 5, 7] = 4095
    merged = merge(counts)
    assert np.flatnonzero(merged.saturated).tolist() == [5 * 200 + 7]
    shortest_range = (4095.0 - BLACK) / TIMES[0]
    assert 0.98 * shortest_range < merged.mean[5, 7] < shortest_range < true_radiance
    assert np.isfinite(merged.variance[5, 7])


def test_doubling_the_exposure_times_changes_nothing():
    counts = np.round(BLACK + 3000.0 * TIMES)[:, None, None] * np.ones((1, *SHAPE))
    doubled = np.round(BLACK + 3000.0 * 2.0 * TIMES)[:, None, None] * np.ones((1, *SHAPE))
    one, two = merge(counts.astype(np.uint16)), merge(doubled.astype(np.uint16), 2.0 * TIMES)
    np.testing.assert_allclose(two.mean, one.mean, rtol=5e-3)
    assert np.all(two.variance < one.variance)


def test_the_order_of_the_exposures_does_not_matter():
    counts = capture(1e5, np.random.default_rng(4))
    np.testing.assert_allclose(merge(counts[::-1].copy(), TIMES[::-1].copy()).mean, merge(counts).mean, rtol=1e-5)


def test_a_dark_pixel_may_be_negative_but_its_variance_is_not():
    merged = merge(capture(0.0, np.random.default_rng(5)))
    assert merged.mean.min() < 0.0
    assert abs(merged.mean.mean()) < 4.0 * merged.mean.std() / np.sqrt(merged.mean.size) + 0.05
    assert merged.variance.min() > 0.0


def test_a_black_level_per_pixel_is_subtracted():
    pattern = np.random.default_rng(6).integers(40, 90, (1, *SHAPE)).astype(np.float32)
    darks = np.repeat(pattern, 3, axis=0)
    counts = (darks + np.round(1e4 * TIMES)[:, None, None]).astype(np.uint16)
    np.testing.assert_allclose(merge_bracket(counts, TIMES, darks, SENSOR).mean, 1e4, rtol=1e-3)


@pytest.mark.parametrize(
    ("counts_shape", "n_times", "dark_shape"),
    [((3, 4, 5), 2, (3, 4, 5)), ((3, 4, 5), 3, (4, 5)), ((3, 4, 5), 3, (3, 5, 4))],
)
def test_shapes_that_do_not_agree_are_refused_with_what_they_are(counts_shape, n_times, dark_shape):
    with pytest.raises(ValueError, match=r"do not agree; the first two must be \(exposures, height, width\)"):
        merge_bracket(np.zeros(counts_shape, np.uint16), np.ones(n_times), np.zeros(dark_shape, np.float32), SENSOR)


def test_an_exposure_time_of_zero_is_refused():
    with pytest.raises(ValueError, match="each must be positive"):
        merge_bracket(np.zeros((2, 4, 5), np.uint16), np.array([0.0, 1.0]), np.zeros((2, 4, 5), np.float32), SENSOR)
