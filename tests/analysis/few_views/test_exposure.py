import numpy as np

from analysis.few_views.exposure import LIMIT, foretold, stepped


def test_a_brighter_view_gets_more_power_and_the_mean_stays():
    residual = [np.full(9, 0.1), np.full(9, -0.1), np.array([])]
    found = stepped(np.zeros(3), residual)
    assert found[0] > 0.0 > found[1]
    assert abs(found.mean()) < 1e-12


def test_no_power_runs_away():
    assert np.abs(stepped(np.zeros(2), [np.full(3, 9.0), np.full(3, -9.0)])).max() == LIMIT


def test_a_camera_that_exposes_by_what_it_sees_is_foretold():
    rng = np.random.default_rng(0)
    distance, brightness = rng.uniform(150.0, 300.0, 9), rng.uniform(0.1, 0.5, 9)

    def law(d: np.ndarray, b: np.ndarray) -> np.ndarray:
        return 0.3 * np.log(d**2) - 0.4 * np.log(b)

    known, new = slice(0, 7), slice(7, 9)
    power = law(distance, brightness)
    told = foretold(power[known], distance[known], brightness[known], distance[new], brightness[new])
    plain = np.full(2, power[known].mean())
    assert np.abs(told - power[new]).max() < 0.5 * np.abs(plain - power[new]).max()


def test_three_views_have_no_law():
    told = foretold(np.array([0.1, 0.2, 0.3]), np.ones(3), np.ones(3), np.ones(2), np.ones(2))
    np.testing.assert_allclose(told, 0.2)
