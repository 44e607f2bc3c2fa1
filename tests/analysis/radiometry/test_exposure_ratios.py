import numpy as np
import pytest

from analysis.radiometry.exposure_ratios import ExposureRatios, combine_ratios, estimate_exposure_ratios
from analysis.radiometry.hdr import Sensor

SENSOR = Sensor(saturation_level=4095.0, conversion_gain=2.5, read_noise=3.0)
NOMINAL = np.array([0.001, 0.004, 0.016, 0.064])
TRUSTED = 3990.0


def samples(true_times: np.ndarray, seed: int = 0, n: int = 20_000, black_error: float = 0.0, darkest: float = 1e3):
    """Counts above black of a scene of three decades, Poisson, read noise and rounding, clipped."""
    rng = np.random.default_rng(seed)
    radiance = 10.0 ** rng.uniform(np.log10(darkest), 6.0, n)
    electrons = rng.poisson(np.minimum(radiance * true_times[:, None], 2e4) * 2.5) + 3.0 * rng.standard_normal((4, n))
    return np.minimum(np.round(electrons / 2.5), 4031.0) + black_error


def estimate(counts: np.ndarray) -> ExposureRatios:
    return estimate_exposure_ratios(counts, np.full(counts.shape[1], TRUSTED), NOMINAL, SENSOR)


def test_ratios_come_back_within_their_sigmas_without_bias():
    true_times = NOMINAL * np.array([1.02, 1.0, 0.99, 1.0])
    z = []
    for seed in range(30):
        out = estimate(samples(true_times, seed, 4000))
        z.append((out.ratio - true_times[1:] / true_times[:-1]) / out.sigma)
    assert np.abs(np.mean(z, axis=0)).max() < 4.0 / np.sqrt(30)
    assert np.std(z) == pytest.approx(1.0, abs=0.2)


def test_times_that_are_two_percent_off_are_found_and_put_right():
    true_times = NOMINAL * np.array([0.98, 1.0, 1.02, 1.0])
    out = estimate(samples(true_times))
    assert (np.abs(out.deviation) > 0.01).all()
    assert out.adopted.all()
    np.testing.assert_allclose(out.time_factors, [0.98, 1.0, 1.02, 1.0], atol=1e-3)


def test_true_times_are_left_alone():
    out = estimate(samples(NOMINAL))
    assert not out.adopted.any()
    np.testing.assert_array_equal(out.time_factors, 1.0)
    assert np.abs(out.deviation).max() < 2e-3


def test_few_dark_pixels_do_not_bias_the_ratio():
    """20 counts of 2 electrons each in the shorter exposure: plain regression is a percent too low there."""
    rng = np.random.default_rng(5)
    x, y = (rng.poisson(2.5 * 30.0 * k, (1, 200_000)) / 2.5 for k in (1.0, 2.0))
    out = estimate_exposure_ratios(
        np.concatenate([x, y]), np.full(200_000, TRUSTED), np.array([0.001, 0.002]), Sensor(4095.0, 2.5, 0.5)
    )
    assert out.ratio[0] == pytest.approx(2.0, abs=4.0 * out.sigma[0])
    assert out.sigma[0] < 0.05


@pytest.mark.parametrize("black_error", [4.0, 0.0, -4.0])
def test_a_wrong_black_level_is_found_and_feigns_no_wrong_times(black_error: float):
    out = estimate(samples(NOMINAL, black_error=black_error))
    assert np.abs(out.deviation).max() < 0.005
    np.testing.assert_allclose(out.black_error, black_error, atol=0.5)
    assert (np.abs(out.black_error - black_error) < 4.0 * out.black_sigma).all()


def test_what_moved_between_two_exposures_is_no_ratio():
    counts = samples(NOMINAL)
    counts[1, ::20] = counts[1, ::20] * 0.3
    assert np.abs(estimate(counts).deviation).max() < 0.003


def test_a_linear_camera_has_the_slope_one():
    assert estimate(samples(NOMINAL)).slope == pytest.approx(1.0, abs=2e-3)
    assert estimate(np.maximum(samples(NOMINAL), 0.0) ** 0.9).slope == pytest.approx(0.9, abs=0.02)


def test_exposures_without_common_pixels_have_no_ratio():
    counts = samples(NOMINAL, darkest=9e5)
    counts[2:] = 4031.0
    out = estimate(counts)
    assert np.isnan(out.ratio[1:]).all()
    assert np.isinf(out.sigma[1:]).all()
    assert not out.adopted[1:].any()
    assert np.isnan(out.slope)
    np.testing.assert_array_equal(out.time_factors, 1.0)


def test_several_sets_are_weighted_by_their_sigmas_and_scatter_widens_them():
    def one(ratio: float, sigma: float) -> ExposureRatios:
        nominal, black = np.array([2.0]), (np.array([0.0]), np.array([0.1]))
        return ExposureRatios(nominal, np.array([ratio]), np.array([sigma]), np.array([500]), *black)

    together = combine_ratios([one(2.01, 0.01), one(2.03, 0.02), one(np.nan, np.inf)])
    assert together.ratio[0] == pytest.approx((2.01 * 4 + 2.03) / 5)
    assert together.sigma[0] == pytest.approx(0.01 / np.sqrt(1.25), rel=1e-6)
    flicker = combine_ratios([one(2.0 + 0.05 * (-1) ** i, 0.001) for i in range(10)])
    assert flicker.sigma[0] == pytest.approx(0.05 / 3.0, rel=0.05)


def test_times_that_do_not_ascend_are_refused():
    with pytest.raises(ValueError, match="they must ascend, one for each of 4"):
        estimate_exposure_ratios(samples(NOMINAL), np.full(20_000, TRUSTED), NOMINAL[::-1], SENSOR)
