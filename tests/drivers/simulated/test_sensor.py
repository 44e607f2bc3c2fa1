import numpy as np
import pytest

from drivers.simulated.sensor import Sensor, mosaic

N = 400


def flat(electrons: float) -> np.ndarray:
    return np.full((N, N), electrons, dtype=np.float32)


@pytest.mark.parametrize("electrons", [0.0, 10.0, 49.0, 51.0, 500.0, 8000.0])
def test_noise_is_shot_noise_and_read_noise(electrons: float):
    sensor = Sensor()
    counts = sensor.counts(flat(electrons), 0.0, np.random.default_rng(1)).astype(float)
    expected = (electrons + sensor.read_noise**2) / sensor.conversion_gain**2 + 1.0 / 12.0
    assert counts.var() == pytest.approx(expected, rel=0.02)
    assert counts.mean() == pytest.approx(sensor.black_level + electrons / sensor.conversion_gain, abs=0.5)


def test_darkness_grows_with_the_exposure_time():
    sensor = Sensor(dark_current=100.0)
    short, long = (sensor.counts(flat(0.0), t, np.random.default_rng(2)).mean() for t in (0.0, 1.0))
    assert long - short == pytest.approx(100.0 / sensor.conversion_gain, rel=0.01)


def test_too_much_light_clips_at_the_end_of_the_converter():
    sensor = Sensor()
    counts = sensor.counts(flat(1e6), 0.01, np.random.default_rng(3))
    assert np.all(counts == 4095)
    assert counts.dtype == np.uint16


def test_white_fills_half_of_the_range_in_ten_milliseconds():
    sensor = Sensor()
    white = 0.85 / np.pi / 350.0**2
    counts = 0.010 * sensor.sensitivity(350.0) * white / sensor.conversion_gain
    assert counts == pytest.approx(0.5 * (4095 - sensor.black_level))


def test_the_mosaic_is_rggb():
    picture = np.broadcast_to(np.array([1.0, 2.0, 3.0], dtype=np.float32), (4, 6, 3))
    np.testing.assert_array_equal(mosaic(picture), np.tile([[1.0, 2.0], [2.0, 3.0]], (2, 3)))
