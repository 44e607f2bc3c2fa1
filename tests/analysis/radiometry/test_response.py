import numpy as np
import pytest

from analysis.radiometry.response import table_response
from instrument.files.validation import InvalidInputError
from tests.analysis.radiometry.responses import gamma_response, srgb_response


def test_srgb_is_that_of_the_standard():
    curve = srgb_response().curve[0]
    assert curve[0] == 0.0
    assert curve[255] == pytest.approx(1.0)
    assert curve[10] == pytest.approx(10 / 255 / 12.92)
    assert curve[188] == pytest.approx(0.5029, abs=1e-4)


def test_a_gamma_is_a_power_of_the_count():
    curve = gamma_response(2.2).curve[0]
    np.testing.assert_allclose(curve[[51, 255]], [0.2**2.2, 1.0])


def test_each_channel_is_looked_up_in_its_own_curve():
    levels = np.linspace(0.0, 1.0, 256)
    response = table_response(np.stack([levels, levels**2, levels**3]))
    counts = np.full((2, 3, 3), 51, np.uint8)
    np.testing.assert_allclose(response.linearise(counts)[1, 2], [0.2, 0.04, 0.008], rtol=1e-6)
    np.testing.assert_allclose(table_response(levels).linearise(counts), 0.2, rtol=1e-6)


def test_counts_that_the_curve_does_not_have_are_refused():
    with pytest.raises(ValueError, match="counts go up to 300; the response curve has 256 levels"):
        srgb_response().linearise(np.full((2, 2, 3), 300, np.uint16))
    with pytest.raises(ValueError, match="counts of 1 channels do not fit a curve of 3"):
        table_response(np.ones((3, 256))).linearise(np.zeros((2, 2, 1), np.uint8))


def test_all_that_is_wrong_with_a_table_is_said_at_once():
    table = np.linspace(0.0, 1.0, 256)
    table[7], table[100] = -1.0, 0.1
    with pytest.raises(InvalidInputError) as caught:
        table_response(table)
    assert "negative or missing" in str(caught.value)
    assert "falls from count 6 to 7" in str(caught.value)
    with pytest.raises(InvalidInputError, match=r"has the shape \(2, 256\); allowed are 1 or 3 rows"):
        table_response(np.ones((2, 256)))


def test_its_sensor_has_the_noise_of_a_count_at_mid_range_and_in_the_dark():
    response = srgb_response()
    sensor, curve = response.sensor(), response.curve[0]
    for count in (2, 60, 128, 200):
        expected = 0.5 * (curve[count + 1] - curve[count - 1])
        sigma = np.sqrt(curve[count] / sensor.conversion_gain + sensor.read_variance)
        assert sigma == pytest.approx(expected, rel=0.25)
    assert np.all(sensor.saturation_level == curve[254])
