import numpy as np
import pytest

from analysis.radiometry.hdr import Sensor
from analysis.radiometry.sensor_noise import assumed_sensor, estimate_noise_model
from tests.analysis.radiometry.test_exposure_ratios import NOMINAL, TRUSTED, samples


def test_gain_and_read_noise_are_found_from_a_bracket():
    counts = samples(NOMINAL, n=40_000)
    gain, read_noise = estimate_noise_model(
        counts, np.full(40_000, TRUSTED), NOMINAL, assumed_sensor(4095.0, 64.0, 1.0)
    )
    assert gain == pytest.approx(2.5, rel=0.05)
    assert read_noise == pytest.approx(3.0, rel=0.25)


def test_one_exposure_cannot_tell_the_noise():
    counts = samples(NOMINAL)[:1]
    assert estimate_noise_model(counts, np.full(20_000, TRUSTED), NOMINAL[:1], Sensor(4095.0, 2.5, 3.0)) is None


def test_exposures_without_common_pixels_cannot_tell_the_noise():
    counts = np.full((4, 20_000), 4031.0)
    assert estimate_noise_model(counts, np.full(20_000, TRUSTED), NOMINAL, Sensor(4095.0, 2.5, 3.0)) is None
