from dataclasses import replace

import pytest

from analysis.results.summary import HeldOutView, Quantiles, Summary
from analysis.results.trust import cautions, failures

GOOD = Summary(
    n_views=7,
    n_pixels=100,
    n_unsolved=0,
    theta_h_range_deg=(1.0, 60.0),
    theta_d_deg=(1.0, 2.0),
    camera_moves=True,
    normal_sigma_deg=Quantiles(0.1, 0.1, 0.2),
    relative_error=0.01,
)


def left_out(ours: float, lambert: float) -> HeldOutView:
    return HeldOutView(0, 100, 10, ours, lambert, 20.0, 20.0, 0.0)


def test_a_good_result_is_told_nothing_of():
    assert failures(GOOD) == []
    assert cautions(GOOD) == []


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"n_unsolved": 100}, "NO PIXEL IS SOLVED"),
        ({"left_out": (left_out(0.58, 0.4),)}, "WORSE THAN BY A LAMBERTIAN FIT"),
        ({"theta_d_deg": (13.0, 22.0)}, "OUTSIDE THE DOMAIN"),
        ({"theta_d_deg": (13.0, 22.0), "camera_moves": False}, "camera never moves"),
    ],
)
def test_what_cannot_be_trusted_fails(changed: dict, word: str):
    (text,) = failures(replace(GOOD, **changed))
    assert word in text


def test_what_is_only_a_little_worse_than_a_lambertian_fit_on_a_lambertian_sample_is_no_failure():
    assert failures(replace(GOOD, left_out=(left_out(0.0232, 0.0231),))) == []


@pytest.mark.parametrize(
    ("changed", "word"),
    [
        ({"theta_h_range_deg": (2.0, 19.0)}, "Add poses with more tilt"),
        ({"n_unsolved": 3}, "3 of 100 pixels are unsolved"),
        ({"relative_error": 0.16}, "16.0 % of the radiance"),
    ],
)
def test_what_a_user_should_know_is_told(changed: dict, word: str):
    (text,) = cautions(replace(GOOD, **changed))
    assert word in text


def test_a_file_from_before_these_figures_is_judged_by_what_it_has():
    assert failures(replace(GOOD, theta_d_deg=None, camera_moves=None)) == []
