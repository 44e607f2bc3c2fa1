"""Each way in which lens, poses and boards go wrong is told by its check."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from analysis.camera.board_findings import BoardFindings
from analysis.camera.board_layout import rotation_from_vector
from analysis.camera.board_statement import MarkerEvidence
from analysis.camera.calibration import CameraCalibration, CornerOutlier
from analysis.reporting.checks import Status
from analysis.reporting.geometry_checks import (
    board_checks,
    corner_rms,
    geometry_checks,
    halves,
    noise_rms,
    outliers,
    stage,
    worst_view,
)
from tests.analysis.calibrations import calibration, camera, facts, named
from tests.analysis.camera.test_calibration import BOARDS, NOISE, POSES

I_POSE = 1 + np.arange(len(POSES))


def findings(**changes: object) -> BoardFindings:
    good = BoardFindings(frozenset(), 1.0, 0.0005, np.full(4, 0.01), np.full(4, 0.02))
    return replace(good, **changes)


def with_residuals(residuals: tuple[np.ndarray, ...]) -> CameraCalibration:
    return replace(camera(), bundle=replace(camera().bundle, residuals=residuals))


def test_a_good_calibration_passes_every_check() -> None:
    checks = list(geometry_checks(calibration(), facts()))
    assert {c.status for c in checks} == {Status.PASS}


@pytest.mark.parametrize(("n_explained", "status"), [(100, Status.PASS), (90, Status.WARN), (70, Status.FAIL)])
def test_a_board_whose_markers_are_elsewhere_warns_and_then_fails(n_explained: int, status: Status) -> None:
    """With what would fit, where that is known."""
    fits = replace(BOARDS[0], squares=(9, 5)) if status is Status.FAIL else None
    markers = (MarkerEvidence(100, 100, None), MarkerEvidence(100, n_explained, fits), None)
    (found,) = (c for c in board_checks(findings(markers=markers), BOARDS) if c.name == "markers of the boards")
    assert found.status is status
    if fits is not None:
        assert "board 1: 70 of 100" in found.number
        assert "squares = [9, 5]" in found.remedy


def test_without_boards_there_is_nothing_to_judge() -> None:
    assert not list(geometry_checks(calibration(camera=None, boards=None, lighting=None), facts()))


def test_corners_are_compared_with_what_their_noise_explains() -> None:
    found = corner_rms(camera())
    assert noise_rms(camera()) == pytest.approx(np.sqrt(2.0) * NOISE)
    assert found.status is Status.PASS
    assert found.value == pytest.approx(noise_rms(camera()), rel=0.2)


@pytest.mark.parametrize(("times", "status"), [(2.0, Status.PASS), (6.0, Status.WARN), (20.0, Status.FAIL)])
def test_corners_that_are_worse_than_their_noise_warn_and_then_fail(times: float, status: Status) -> None:
    found = corner_rms(with_residuals(tuple(times * r for r in camera().residuals)))
    assert found.status is status
    assert found.value == pytest.approx(times * camera().rms)


def test_the_worst_view_is_named_by_its_pose() -> None:
    shaken = tuple(r * (5.0 if v == 4 else 1.0) for v, r in enumerate(camera().residuals))
    found = worst_view(with_residuals(shaken), I_POSE)
    assert found.status is Status.WARN
    assert "pose 5" in found.number
    assert "pose 5" in found.remedy
    assert worst_view(camera(), I_POSE).status is Status.PASS


def test_corners_left_out_are_counted_and_located() -> None:
    left_out = tuple(CornerOutlier(2, board, (0.0, 0.0), (5.0, 5.0)) for board in (0, 1, 0, 0))
    found = outliers(replace(camera(), outliers=left_out), I_POSE)
    n = sum(len(c) for c in camera().corners) + 4
    assert found.number == f"4 of {n} corners, most of them: 3 in pose 3 on board 0, 1 in pose 3 on board 1"
    assert found.status is Status.PASS
    assert outliers(replace(camera(), outliers=5 * left_out), I_POSE).status is Status.WARN


@pytest.mark.parametrize(("z", "status"), [(1.2, Status.PASS), (3.0, Status.WARN), (5.0, Status.FAIL)])
def test_halves_that_differ_by_more_than_their_sigma_warn_and_then_fail(z: float, status: Status) -> None:
    found = halves(replace(camera(), halves_z={"f": z, "cx": -z}))
    assert found.status is status
    assert found.value == pytest.approx(z)


def test_too_few_views_for_two_halves_are_told() -> None:
    found = halves(replace(camera(), halves_z={}))
    assert found.status is Status.WARN
    assert "at least 8 views" in found.remedy


@pytest.mark.parametrize(
    ("scale", "status"), [(1.001, Status.PASS), (1.002, Status.WARN), (1.0101, Status.FAIL), (0.99, Status.FAIL)]
)
def test_squares_of_another_size_fail_beyond_chance_and_three_per_mille(scale: float, status: Status) -> None:
    assert named(board_checks(findings(scale=scale), BOARDS), "scale of the squares").status is status


def test_squares_that_were_printed_small_fail_with_the_size_that_they_measure() -> None:
    # Boards of squares that are 2 % smaller than stated look 2 % too far apart.
    found = named(board_checks(findings(scale=1.0 / 0.98), BOARDS), "scale of the squares")
    assert found.status is Status.FAIL
    assert "the squares measure 4.900 mm, not 5" in found.remedy


def test_without_a_scale_to_compare_there_is_no_check_of_it() -> None:
    names = [c.name for c in board_checks(findings(scale=np.nan, scale_sigma=np.nan), BOARDS)]
    assert "scale of the squares" not in names


def test_a_bowed_board_and_a_moved_one_are_named() -> None:
    checks = list(board_checks(findings(out_of_plane=np.array([0, 0.3, 0, 0]), moved=np.array([0, 0, 0, 0.9])), BOARDS))
    assert named(checks, "flatness of the boards").status is Status.WARN
    assert "board 1" in named(checks, "flatness of the boards").remedy
    assert named(checks, "place of the boards").status is Status.WARN
    assert "board 3" in named(checks, "place of the boards").remedy


def test_an_old_pattern_is_told_and_passes() -> None:
    found = named(board_checks(findings(legacy=frozenset({0, 2})), BOARDS), "pattern of the boards")
    assert found.status is Status.PASS
    assert "boards 0, 2 have the pattern of OpenCV before 4.6" in found.number


def on_stage(tilt: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """Return rotations sample to camera of a turntable on a tilt, before a camera that stands askew."""
    askew = rotation_from_vector(np.array([[3.0, 0.2, -0.1]]))
    x, z = np.eye(3)[[0, 2]]
    return (
        askew
        @ rotation_from_vector(np.deg2rad(tilt)[:, None] * x)
        @ rotation_from_vector(np.deg2rad(turn)[:, None] * z)
    )


def test_a_stage_that_stands_where_it_says_passes_however_the_camera_stands() -> None:
    tilt, turn = np.array([0.0, 20, 20, 45, 45, 30]), np.array([0.0, 90, 210, 33, -60, 120])
    (found,) = stage(on_stage(tilt, turn), tilt, turn, I_POSE[:6])
    assert found.status is Status.PASS
    assert found.value < 1e-5


def test_a_pose_where_the_sample_slipped_is_named() -> None:
    tilt, turn = np.array([0.0, 20, 20, 45, 45, 30]), np.array([0.0, 90, 210, 33, -60, 120])
    slipped = turn + np.array([0, 0, 0, 2.0, 0, 0])
    (found,) = stage(on_stage(tilt, slipped), tilt, turn, I_POSE[:6])
    assert found.status is Status.FAIL
    assert "most at pose 4" in found.number


def test_poses_left_out_are_listed_with_their_reasons() -> None:
    found = named(geometry_checks(calibration(dropped=("pose 0: 3 board corners",)), facts()), "poses left out")
    assert found.status is Status.WARN
    assert f"1 of {len(POSES) + 1}: pose 0: 3 board corners" in found.number
