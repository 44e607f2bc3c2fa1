"""Each way in which light and fall-off go wrong is told by its check."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.light.flat_field import FlatField
from analysis.reconstruction.error_budget import ErrorBudget
from analysis.registration.lighting import LightOffset
from analysis.reporting.calibration_checks import calibration_checks, coverage_of
from analysis.reporting.checks import Status, by_severity
from analysis.reporting.light_checks import budget_check, drift, flat_checks, light_checks, offset, spread, theta_d
from tests.analysis.calibrations import OFFSET, calibration, facts, lighting, named


def flat(**changes: object) -> FlatField:
    matrix = np.array([[900.0, 0.0, 319.5], [0.0, 900.0, 239.5], [0.0, 0.0, 1.0]])
    good = FlatField(
        camera_matrix=matrix,
        distortion=np.zeros(5),
        image_size=(640, 480),
        light_offset=np.zeros(3),
        vignetting=np.array([-0.3, 0.0, 0.0]),
        centre=np.array([319.5, 239.5]),
        lobe_exponent=1.0,
        lobe_gradient=np.zeros(2),
        rms=0.005,
        share_clipped=0.0,
    )
    return replace(good, **changes)


def test_a_good_light_passes_every_check() -> None:
    checks = list(light_checks(calibration(flat=flat()), facts()))
    assert len(checks) == 9
    assert {c.status for c in checks} == {Status.PASS}


def test_without_an_area_only_the_flat_field_is_judged() -> None:
    names = [c.name for c in light_checks(calibration(flat=flat(), lighting=None), facts())]
    assert names == ["gain of the flat field", "residual of the flat field", "flat field at other distances"]


def test_the_difference_angle_is_half_of_what_lies_between_camera_and_light() -> None:
    found = theta_d(LightOffset(np.array([11.0, 0.0, 0.0]), np.full(3, 0.5)), 170.0)
    assert found.value == pytest.approx(np.rad2deg(np.arctan(11.0 / 170.0)) / 2.0)
    assert "1.85 ± 0.08 deg" in found.number
    assert found.status is Status.PASS


def test_a_light_too_far_beside_the_lens_fails_and_says_the_angle() -> None:
    found = theta_d(LightOffset(np.array([100.0, 0.0, 220.0]), np.zeros(3)), 100.0)
    assert found.status is Status.FAIL
    assert f"{found.value:.2f}" in found.number


def test_a_light_far_from_where_it_was_stated_warns() -> None:
    assert offset(LightOffset(OFFSET, np.full(3, 0.4)), facts()).status is Status.PASS
    found = offset(LightOffset(OFFSET, np.full(3, 0.4)), facts(light_offset=np.array([-11.0, 0.0, 0.0])))
    assert found.status is Status.WARN


def test_a_power_that_spreads_warns_and_names_the_pose() -> None:
    power = lighting().photometry.light_power.copy()
    power[6] *= 1.6
    found = spread(replace(lighting().photometry, light_power=power), calibration().i_pose)
    assert found.status is Status.WARN
    assert "pose 7 " in found.number


def test_the_drift_that_was_injected_is_told() -> None:
    photometry = lighting().photometry
    found = drift(photometry, facts().seconds)
    assert found.value == pytest.approx(0.01, abs=0.003)
    assert found.status is Status.PASS
    faster = replace(photometry, light_power=photometry.light_power * np.linspace(1.0, 0.9, len(facts().seconds)))
    assert drift(faster, facts().seconds).status is Status.WARN


def test_poses_without_times_have_no_drift() -> None:
    untimed = facts(seconds=np.full(len(facts().seconds), np.nan))
    assert "drift of the light" not in [c.name for c in light_checks(calibration(), untimed)]


def test_a_flat_field_that_brightens_corners_by_more_than_two_warns() -> None:
    found = named(flat_checks(flat(vignetting=np.array([-0.8, 0.0, 0.0])), 160.0), "gain of the flat field")
    assert found.status is Status.WARN
    assert found.value > 2.0


@pytest.mark.parametrize(
    ("only_at", "distance", "status"),
    [(None, 160.0, Status.PASS), (165.0, 160.0, Status.PASS), (300.0, 160.0, Status.WARN), (300.0, None, Status.WARN)],
)
def test_one_card_is_good_at_its_own_distance_only(
    only_at: float | None, distance: float | None, status: Status
) -> None:
    assert named(flat_checks(flat(only_at_mm=only_at), distance), "flat field at other distances").status is status


def test_the_source_that_dominates_is_named_with_its_remedy() -> None:
    found = budget_check(ErrorBudget({"image noise": 0.1, "registration": 0.8, "fall-off": 0.0}))
    assert found.status is Status.WARN
    assert found.value == pytest.approx(np.hypot(0.1, 0.8))
    assert "registration dominates: larger or more boards" in found.remedy


def test_the_checks_of_a_calibration_come_the_worst_first() -> None:
    checks = by_severity(calibration_checks(calibration(dropped=("pose 0: dark",)), facts()))
    assert checks[0].status is Status.WARN
    assert checks[-1].status is Status.PASS
    assert [c.status for c in checks] == sorted((c.status for c in checks), key=[*Status][::-1].index)


def test_half_angles_are_told_where_there_is_an_area() -> None:
    assert coverage_of(calibration(), facts(area_mm=None)) is None
    reached = coverage_of(calibration(), facts())
    assert reached is not None
    names = [c.name for c in calibration_checks(calibration(), facts())]
    assert names[-1] == "coverage of half angles"
