import cv2
import numpy as np
import pytest

from analysis.boards import (
    border_points,
    charuco_board,
    detect_corners,
    detection_image,
    sample_from_board,
    white_points,
)
from analysis.camera_calibration import CameraCalibration, calibrate_camera, usable_views
from instrument.records import Board
from instrument.validation import InvalidInputError

WIDTH, HEIGHT = 640, 480
MATRIX = np.array([[900.0, 0.0, 324.0], [0.0, 900.0, 235.0], [0.0, 0.0, 1.0]])
LEFT = Board("charuco", "DICT_4X4_100", 0, (6, 6), 6.0, 4.5, (-40.0, 18.0))
RIGHT = Board("charuco", "DICT_4X4_100", 18, (6, 6), 6.0, 4.5, (4.0, 18.0))
BOARDS = (LEFT, RIGHT)
PER_MM, SUPERSAMPLING = 20, 3


def pose(tilt_deg: float, azimuth_deg: float, roll_deg: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation and translation, sample to camera, of a camera 160 mm from the centre that looks at it."""
    tilt, azimuth, roll = np.deg2rad([tilt_deg, azimuth_deg, roll_deg])
    centre = 160.0 * np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    forward = -centre / np.linalg.norm(centre)
    level = np.cross(forward, [0.0, 1.0, 0.0])
    level /= np.linalg.norm(level)
    right = np.cos(roll) * level + np.sin(roll) * np.cross(forward, level)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return rotation, -rotation @ centre


POSES = [pose(0, 0), pose(25, 0, 20), pose(30, 72), pose(28, 144, -15), pose(32, 216), pose(22, 288, 30)]


def project(points: np.ndarray, rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    seen = (points @ rotation.T + translation) @ MATRIX.T
    return seen[:, :2] / seen[:, 2:]


def photograph(rotation: np.ndarray, translation: np.ndarray, boards: tuple[Board, ...] = BOARDS) -> np.ndarray:
    """Return a picture of the boards on a white sheet, each pixel the mean over its own square."""
    size = (SUPERSAMPLING * WIDTH, SUPERSAMPLING * HEIGHT)
    # Pixel centres are integers, so a fine pixel i lies at (i + 1/2) / SUPERSAMPLING - 1/2 of the picture.
    k, half = float(SUPERSAMPLING), (SUPERSAMPLING - 1) / 2.0
    fine_from_pixel = np.array([[k, 0.0, half], [0.0, k, half], [0.0, 0.0, 1.0]])
    pixel_from_plane = MATRIX @ np.stack([rotation[:, 0], rotation[:, 1], translation], axis=1)
    fine = np.full(size[::-1], 255, np.uint8)
    for board in boards:
        across, down = (int(n * board.square_mm * PER_MM) for n in board.squares)
        x0, y0 = board.corner_mm
        plane_from_print = np.array(
            [[1.0 / PER_MM, 0.0, x0 + 0.5 / PER_MM], [0.0, -1.0 / PER_MM, y0 - 0.5 / PER_MM], [0.0, 0.0, 1.0]]
        )
        printed = charuco_board(board).generateImage((across, down))
        warp = fine_from_pixel @ pixel_from_plane @ plane_from_print
        cv2.warpPerspective(printed, warp, size, fine, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT)
    return cv2.resize(fine, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)


@pytest.fixture(scope="module")
def found():
    return [detect_corners(photograph(*p), BOARDS) for p in POSES]


@pytest.fixture(scope="module")
def calibration(found) -> CameraCalibration:
    return calibrate_camera(found, (WIDTH, HEIGHT), 850.0)


def test_every_corner_of_every_board_is_found(found):
    for corners in found:
        assert len(corners) == 50
        np.testing.assert_array_equal(np.bincount(corners.board), [25, 25])


def test_corners_lie_within_a_fifth_of_a_pixel_of_their_true_place(found):
    """Also a check of handedness: a mirrored or upside-down board would be off by its own size."""
    for corners, p in zip(found, POSES, strict=True):
        off = corners.image_points - project(corners.object_points, *p)
        assert np.median(np.linalg.norm(off, axis=1)) < 0.2
        assert np.linalg.norm(off.mean(axis=0)) < 0.1


def test_board_coordinates_run_down_and_those_of_the_sample_up():
    points = sample_from_board(LEFT, np.array([[0.0, 0.0], [6.0, 0.0], [0.0, 6.0]]))
    np.testing.assert_allclose(points, [[-40.0, 18.0, 0.0], [-34.0, 18.0, 0.0], [-40.0, 12.0, 0.0]])


def test_corners_of_a_board_lie_inside_it(found):
    for index, board in enumerate(BOARDS):
        x, y, z = found[0].object_points[found[0].board == index].T
        assert np.all((x > board.corner_mm[0]) & (x < board.corner_mm[0] + 36.0))
        assert np.all((y < board.corner_mm[1]) & (y > board.corner_mm[1] - 36.0))
        assert np.all(z == 0.0)


def test_a_picture_without_boards_has_no_corners():
    nothing = detect_corners(np.full((HEIGHT, WIDTH), 128, np.uint8), BOARDS)
    assert len(nothing) == 0
    assert nothing.object_points.shape == (0, 3)
    assert not usable_views([nothing]).any()


def test_a_board_that_the_rig_does_not_have_is_not_taken_for_another():
    picture = photograph(*POSES[0], boards=(RIGHT,))
    assert len(detect_corners(picture, (LEFT,))) == 0
    assert len(detect_corners(picture, BOARDS)) == 25


def test_the_mosaic_of_a_neutral_board_does_not_show_in_the_picture_for_detection():
    grey = photograph(*POSES[0]).astype(np.float32)
    mosaic = grey.copy()
    mosaic[0::2, 0::2] *= 0.4
    mosaic[1::2, 1::2] *= 0.2
    plain, balanced = detection_image(grey, ""), detection_image(mosaic, "RGGB")
    assert np.percentile(np.abs(plain.astype(int) - balanced), 99) <= 2
    assert len(detect_corners(balanced, BOARDS)) == 50


def test_intrinsics_are_recovered_to_one_percent(calibration: CameraCalibration):
    found = calibration.camera_matrix
    assert found[0, 0] == pytest.approx(900.0, rel=0.01)
    assert found[1, 1] == pytest.approx(900.0, rel=0.01)
    np.testing.assert_allclose(found[:2, 2], MATRIX[:2, 2], atol=9.0)
    assert calibration.rms < 0.3


def test_the_camera_is_found_where_it_stood(calibration: CameraCalibration):
    truth = np.stack([-r.T @ t for r, t in POSES])
    np.testing.assert_allclose(calibration.camera_position, truth, atol=2.0)
    assert np.all(calibration.camera_position[:, 2] > 0.0)


def test_the_stated_sigma_covers_the_error_of_the_focal_length(calibration: CameraCalibration):
    sigma = calibration.intrinsics_sigma
    assert set(sigma) == {"fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2"}
    assert abs(calibration.camera_matrix[0, 0] - 900.0) < 6.0 * sigma["fx"]


def test_wrong_corners_are_left_out(found, calibration: CameraCalibration):
    image_points = found[2].image_points.copy()
    image_points[[3, 17]] += 25.0
    broken = [*found[:2], type(found[2])(found[2].object_points, image_points, found[2].board), *found[3:]]
    result = calibrate_camera(broken, (WIDTH, HEIGHT), 850.0)
    assert result.n_outliers >= 2
    assert result.camera_matrix[0, 0] == pytest.approx(calibration.camera_matrix[0, 0], rel=2e-3)
    assert result.rms < 1.2 * calibration.rms


def test_too_few_views_are_refused_with_what_to_check(found):
    with pytest.raises(InvalidInputError) as caught:
        calibrate_camera(found[:3], (WIDTH, HEIGHT), 850.0)
    text = str(caught.value)
    assert "3 views show at least 8 board corners; at least 4 are needed" in text
    assert "Check the boards in the rig file against the printed ones, focus and exposure." in text


def test_white_points_are_white_on_the_print():
    points = white_points(LEFT, 0.5, 0.3)
    printed = charuco_board(LEFT).generateImage((36 * PER_MM, 36 * PER_MM))
    columns = ((points[:, 0] - LEFT.corner_mm[0]) * PER_MM).astype(int)
    rows = ((LEFT.corner_mm[1] - points[:, 1]) * PER_MM).astype(int)
    assert len(points) > 100
    for di in (-4, 0, 4):
        for dj in (-4, 0, 4):
            assert np.all(printed[rows + di, columns + dj] == 255)


def test_border_points_keep_clear_of_boards_and_area():
    boards = (LEFT, Board("charuco", "DICT_4X4_100", 18, (6, 6), 6.0, 4.5, (40.0, 18.0)))
    points = border_points(boards, (20.0, 20.0), 2.5, 4.0)
    assert len(points) > 10
    x, y, _ = points.T
    assert not np.any((np.abs(x) < 14.0) & (np.abs(y) < 14.0))
    for board in boards:
        left, top = board.corner_mm
        assert not np.any((x > left - 4.0) & (x < left + 40.0) & (y < top + 4.0) & (y > top - 40.0))
