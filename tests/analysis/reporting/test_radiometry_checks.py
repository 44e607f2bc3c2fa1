"""Each way in which counts go wrong is told by its check."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.radiometry.exposure_ratios import ExposureRatios
from analysis.radiometry.response_fit import PicturePrediction
from analysis.radiometry.saturation import Saturation
from analysis.reporting.checks import Check, Status
from analysis.reporting.radiometry_checks import radiometry_checks
from tests.analysis.calibrations import CELL, named, radiometry, ratios
from tests.analysis.radiometry.responses import srgb_response


def check(name: str, **changes: object) -> Check:
    return named(radiometry_checks(radiometry(**changes)), name)


def test_a_good_camera_passes_every_check_and_asks_for_nothing() -> None:
    checks = list(radiometry_checks(radiometry()))
    assert len(checks) == 8
    assert {c.status for c in checks} == {Status.PASS}
    assert not any(c.remedy for c in checks)


@pytest.mark.parametrize("injected", [4.0, -4.0, 0.6])
def test_a_stated_black_level_that_the_darks_contradict_warns(injected: float) -> None:
    found = check("black level", black_nominal=CELL + injected)
    assert found.status is Status.WARN
    assert found.value == pytest.approx(abs(injected))
    assert "state a black level of 64 DN" in found.remedy


def test_one_place_of_the_cell_that_is_off_warns() -> None:
    dark = CELL.copy()
    dark[1, 0] += 0.8
    found = check("black level", black_dark=dark)
    assert found.status is Status.WARN
    assert "64, 64, 64.8, 64" in found.number


def test_half_a_count_of_black_passes() -> None:
    assert check("black level", black_nominal=CELL + 0.5).status is Status.PASS


def test_without_darks_the_exposures_tell_the_black_level() -> None:
    found = check("black level by the exposures", black_dark=None, ratios=ratios(black_error=4.0))
    assert found.status is Status.WARN
    assert "+4.00 ± 0.07 DN too low" in found.number
    assert check("black level by the exposures", black_dark=None).status is Status.PASS


def test_an_error_of_the_black_level_within_its_noise_passes() -> None:
    assert check("black level by the exposures", ratios=ratios(black_error=0.6)).status is Status.PASS


def test_a_black_level_that_nothing_confirms_warns_and_asks_for_darks() -> None:
    found = check("black level", black_dark=None, ratios=ExposureRatios.of_one_exposure())
    assert found.status is Status.WARN
    assert "take darks" in found.remedy


def test_clipping_below_the_stated_level_warns_with_the_level_to_state() -> None:
    lower = Saturation(np.full((2, 2), 3800.0), 4095.0, np.ones((2, 2), bool), np.full((2, 2), 0.01))
    found = check("saturation level", saturation=lower)
    assert found.status is Status.WARN
    assert "state a saturation level of 3800 DN" in found.remedy


@pytest.mark.parametrize(("deviation", "status"), [(0.009, Status.PASS), (-0.02, Status.WARN)])
def test_exposure_ratios_that_are_off_by_more_than_a_percent_warn(deviation: float, status: Status) -> None:
    found = check("exposure ratios", ratios=ratios(deviation))
    assert found.status is status
    assert f"{100 * deviation:+.2f} ± 0.05 %" in found.number


@pytest.mark.parametrize(("share", "status"), [(0.0005, Status.PASS), (0.01, Status.WARN), (0.2, Status.FAIL)])
def test_pixels_clipped_in_every_exposure_come_with_advice(share: float, status: Status) -> None:
    found = check("clipped in every exposure", share_all_clipped=share)
    assert found.status is status
    assert ("exposure a quarter as long" in found.remedy) is (status is not Status.PASS)


def test_a_single_value_that_is_no_number_is_counted() -> None:
    found = check("values that are no numbers", n_nan=1)
    assert found.status is Status.WARN
    assert found.number == "1 of 10000 values looked at"


def test_noise_that_nobody_stated_warns() -> None:
    assert check("noise model", noise_estimated=True).status is Status.WARN


def test_behind_a_response_curve_the_curve_is_judged_and_the_times_are_not() -> None:
    predictions = tuple(PicturePrediction(t, 100, 2.0, 1.0, e, 0.0) for t, e in ((0.1, 0.02), (0.4, 0.15)))
    changes = {"response": srgb_response(), "response_slope": 0.974, "response_predictions": predictions}
    checks = list(radiometry_checks(radiometry(ratios=ratios(0.3), **changes)))
    assert {c.name for c in checks}.isdisjoint({"exposure ratios", "black level", "saturation level", "noise model"})
    assert named(checks, "response curve").status is Status.WARN
    assert "worst 15.0 % (0.4 s)" in named(checks, "response curve").number
    assert named(checks, "slope of the response").status is Status.WARN


def test_a_curve_that_no_bracket_confirms_warns() -> None:
    assert check("response curve", response=srgb_response()).status is Status.WARN
