"""The bundle on corners with known noise: against the truth, against OpenCV, and with boards that are not as stated."""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
import pytest

from analysis.camera.board_detection import BoardCorners
from analysis.camera.board_findings import board_findings
from analysis.camera.board_layout import BoardLayout
from analysis.camera.calibration import CameraCalibration, calibrate_camera
from instrument.files.validation import InvalidInputError
from instrument.session.records import Board
from tests.analysis.board_pictures import HEIGHT, MATRIX, WIDTH, corners_of, pose, project

BOARDS = tuple(
    Board("charuco", "DICT_4X4_100", 8 * k, (4, 4), 5.0, 4.0, corner)
    for k, corner in enumerate([(-45.0, 35.0), (25.0, 35.0), (-45.0, -15.0), (25.0, -15.0)])
)
TRUE = np.concatenate([corners_of(board) for board in BOARDS])
POSES = [pose(0, 0), *(pose(t, a, 3.0 * a / t) for t in (15, 28, 40) for a in np.arange(6) * 60 + t)]
NOISE = 0.02
DISTORTION = (-0.12, 0.1, 0.0, 0.0, 0.0)


def corners_from(
    points: np.ndarray,
    rng: np.random.Generator,
    distortion: tuple = (0,) * 5,
    noise: float = NOISE,
    poses: list = POSES,
) -> list[BoardCorners]:
    """Return what views of `points` show, each corner off by `noise` and saying so."""
    found = []
    for p in poses:
        pixels = project(points, *p, distortion) + noise * rng.standard_normal((len(points), 2))
        found.append(BoardCorners(np.arange(len(points)), pixels, np.tile(noise**2 * np.eye(2), (len(points), 1, 1))))
    return found


def calibrated(corners: list[BoardCorners], boards: tuple[Board, ...] = BOARDS, **given: object) -> CameraCalibration:
    return calibrate_camera(corners, (WIDTH, HEIGHT), BoardLayout.nominal(boards), **given)


@pytest.fixture(scope="module")
def calibration() -> CameraCalibration:
    return calibrated(corners_from(TRUE, np.random.default_rng(0), DISTORTION), focal_length_px=850.0)


@pytest.mark.slow
def test_intrinsics_and_poses_lie_within_their_sigmas_of_the_truth_as_often_as_they_should():
    z = []
    for seed in range(10):
        found = calibrated(corners_from(TRUE, np.random.default_rng(seed), DISTORTION), focal_length_px=850.0)
        truth = {"f": 900.0, "cx": 324.0, "cy": 235.0, "k1": DISTORTION[0], "k2": DISTORTION[1]}
        values = found.bundle.state.lens.values
        place = {"f": 0, "cx": 2, "cy": 3, "k1": 4, "k2": 5}
        z += [(values[place[n]] - truth[n]) / s for n, s in found.intrinsics_sigma.items() if n in truth]
        sigma = np.sqrt(np.diagonal(found.bundle.pose_covariance, axis1=1, axis2=2)[:, 3:])
        z += ((found.translation - np.stack([t for _, t in POSES])) / sigma).ravel().tolist()
    z = np.abs(z)
    assert 0.55 < np.mean(z < 1.0) < 0.9
    assert np.mean(z < 2.0) > 0.9


def test_the_solution_and_its_sigma_agree_with_opencv(calibration: CameraCalibration):
    corners = corners_from(TRUE, np.random.default_rng(0), DISTORTION)
    flags = cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST | cv2.CALIB_FIX_ASPECT_RATIO | cv2.CALIB_USE_INTRINSIC_GUESS
    objects = [TRUE.astype(np.float32)] * len(corners)
    images = [c.image_points.astype(np.float32) for c in corners]
    _, matrix, distortion, _, _, sigma, _, _ = cv2.calibrateCameraExtended(
        objects, images, (WIDTH, HEIGHT), MATRIX.copy(), np.zeros(5), flags=flags
    )
    np.testing.assert_allclose(calibration.camera_matrix, matrix, atol=0.03)
    for k, name in enumerate(("k1", "k2")):
        # Ours weighs down the corners beyond three sigmas.
        assert abs(calibration.distortion[k] - distortion.ravel()[k]) < 0.7 * calibration.intrinsics_sigma[name]
    # Ours also allows for a print that is off by some thousandths of a pixel, which OpenCV takes as perfect.
    assert 0.8 < calibration.intrinsics_sigma["f"] / float(sigma.ravel()[1]) < 1.8


def test_only_the_distortion_that_is_there_is_modelled(calibration: CameraCalibration):
    assert calibration.bundle.freedom.lens == ("f", "cx", "cy", "k1", "k2")
    plain = calibrated(corners_from(TRUE, np.random.default_rng(0)), focal_length_px=850.0)
    assert plain.bundle.freedom.lens == ("f", "cx", "cy")
    np.testing.assert_array_equal(plain.distortion, 0.0)


def test_without_a_focal_length_to_start_from_the_same_is_found(calibration: CameraCalibration):
    alone = calibrated(corners_from(TRUE, np.random.default_rng(0), DISTORTION))
    np.testing.assert_allclose(alone.camera_matrix, calibration.camera_matrix, rtol=1e-5)


def test_both_halves_of_the_views_agree_within_their_sigmas(calibration: CameraCalibration):
    z = np.array(list(calibration.halves_z.values()))
    assert len(z) == 5
    assert np.sqrt(np.mean(z**2)) < 2.0


def test_wrong_corners_are_left_out_and_located(calibration: CameraCalibration):
    corners = corners_from(TRUE, np.random.default_rng(0), DISTORTION)
    moved = corners[2].image_points.copy()
    moved[[3, 17]] += 5.0
    corners[2] = replace(corners[2], image_points=moved)
    found = calibrated(corners, focal_length_px=850.0)
    assert {(o.view, o.board) for o in found.outliers} == {(2, 0), (2, 1)}
    np.testing.assert_allclose(found.outliers[0].residual, 5.0, atol=0.2)
    np.testing.assert_allclose(found.camera_matrix, calibration.camera_matrix, atol=0.3)


def test_a_board_that_lies_elsewhere_is_found_there():
    moved = TRUE.copy()
    moved[9:18] += [0.3, -0.2, 0.15]
    found = calibrated(corners_from(moved, np.random.default_rng(1)), focal_length_px=850.0)
    places = found.bundle.state.layout.position - BoardLayout.nominal(BOARDS).position
    # As a whole the boards stay where they were, so what one is off by is shared among them.
    np.testing.assert_allclose(places[1] - places[[0, 2, 3]].mean(axis=0), [0.3, -0.2, 0.15], atol=0.1)
    findings = board_findings(found.bundle, BoardLayout.nominal(BOARDS), frozenset())
    assert findings.moved.argmax() == 1


def test_boards_that_lie_as_stated_are_not_moved(calibration: CameraCalibration):
    assert not calibration.bundle.freedom.boards.any()
    assert np.isnan(board_findings(calibration.bundle, BoardLayout.nominal(BOARDS), frozenset()).scale)


def test_squares_of_another_size_than_stated_are_found_from_the_distances_between_boards():
    centres = np.repeat([TRUE[9 * k : 9 * k + 9].mean(axis=0) for k in range(4)], 9, axis=0)
    printed_small = centres + 0.99 * (TRUE - centres)
    found = calibrated(corners_from(printed_small, np.random.default_rng(2)), focal_length_px=850.0)
    findings = board_findings(found.bundle, BoardLayout.nominal(BOARDS), frozenset())
    assert findings.scale == pytest.approx(1.0 / 0.99, abs=max(3.0 * findings.scale_sigma, 5e-4))
    assert findings.scale_sigma < 2e-3


def test_a_bowed_board_is_reported_and_does_not_bend_the_lens():
    board = (Board("checkerboard", "", 0, (10, 7), 8.0, 0.0, (-40.0, 28.0)),)
    bowed = corners_of(board[0])
    bowed[:, 2] += 0.4 * (1.0 - (bowed[:, 0] / 32.0) ** 2)
    found = calibrated(corners_from(bowed, np.random.default_rng(3)), board, focal_length_px=850.0)
    findings = board_findings(found.bundle, BoardLayout.nominal(board), frozenset())
    assert findings.out_of_plane[0] == pytest.approx(0.25, abs=0.12)
    assert abs(found.camera_matrix[1, 1] - 900.0) < 3.0 * found.intrinsics_sigma["f"]
    assert found.rms < 1.5 * np.sqrt(2.0) * NOISE


def test_boards_whose_place_is_not_stated_are_measured():
    unplaced = (*BOARDS[:2], *(replace(b, corner_mm=(np.nan, np.nan)) for b in BOARDS[2:]))
    found = calibrated(corners_from(TRUE, np.random.default_rng(4)), unplaced, focal_length_px=850.0)
    np.testing.assert_allclose(found.bundle.state.layout.position, BoardLayout.nominal(BOARDS).position, atol=0.02)


def test_a_board_never_seen_with_another_cannot_be_placed_and_its_views_are_named():
    unplaced = (*BOARDS[:3], replace(BOARDS[3], corner_mm=(np.nan, np.nan)))
    corners = corners_from(TRUE, np.random.default_rng(5))
    corners = [c.select(c.corner >= 27) if v in (3, 5) else c.select(c.corner < 27) for v, c in enumerate(corners)]
    with pytest.raises(InvalidInputError, match=r"views 3, 5 show only boards whose place is to be measured"):
        calibrated(corners, unplaced, focal_length_px=850.0)


def test_too_few_views_are_refused_with_what_to_check():
    with pytest.raises(InvalidInputError) as caught:
        calibrated(corners_from(TRUE, np.random.default_rng(0), poses=POSES[:3]), focal_length_px=850.0)
    text = str(caught.value)
    assert "3 views show at least 8 board corners; at least 4 are needed" in text
    assert "Check the boards in the rig file against the printed ones, focus and exposure." in text


def test_six_views_are_enough_for_a_plain_lens():
    found = calibrated(corners_from(TRUE, np.random.default_rng(0), poses=POSES[:6]), focal_length_px=850.0)
    assert abs(found.camera_matrix[0, 0] - 900.0) < 3.0 * found.intrinsics_sigma["f"]
