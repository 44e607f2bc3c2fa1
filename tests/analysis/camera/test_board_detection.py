"""Boards in pictures that OpenCV drew: which are found, and how near to the truth their corners lie."""

import numpy as np
import pytest

from analysis.camera.board_detection import BoardCorners, _homography, detect_corners, detection_image
from analysis.camera.board_layout import BoardLayout
from analysis.camera.board_pattern import pattern
from analysis.camera.calibration import usable_views
from instrument.session.records import Board
from tests.analysis.board_pictures import (
    BOARDS,
    CHECKER,
    HEIGHT,
    LEFT,
    POSES,
    RIGHT,
    WIDTH,
    corners_of,
    photograph,
    printed,
    project,
)

TRUE = np.concatenate([corners_of(board) for board in BOARDS])


@pytest.fixture(scope="module")
def found() -> list[BoardCorners]:
    return [detect_corners(photograph(*p), "", BOARDS) for p in POSES]


def test_every_corner_of_every_board_is_found(found):
    for corners in found:
        np.testing.assert_array_equal(corners.corner, np.arange(50))


def test_corners_lie_within_hundredths_of_a_pixel_of_their_true_place(found):
    """Also a check of handedness: a mirrored or upside-down board would be off by its own size."""
    for corners, p in zip(found, POSES, strict=True):
        off = corners.image_points - project(TRUE[corners.corner], *p)
        assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.02
        assert np.linalg.norm(off.mean(axis=0)) < 0.01


def test_noise_moves_corners_by_what_is_stated():
    rng = np.random.default_rng(0)
    clean = photograph(*POSES[1])
    at_rest = detect_corners(clean, "", BOARDS)
    moved = [detect_corners(clean + 8.0 * rng.standard_normal(clean.shape, np.float32), "", BOARDS) for _ in range(4)]
    z = [
        (c.image_points - at_rest.image_points) / np.sqrt(np.stack([c.covariance[:, 0, 0], c.covariance[:, 1, 1]], 1))
        for c in moved
    ]
    assert 0.8 < np.sqrt(np.mean(np.square(z))) < 1.2


def test_corners_are_the_same_whatever_colour_the_paper_and_the_light_have():
    grey = photograph(*POSES[2])
    tinted = grey + 30.0
    tinted[0::2, 0::2] *= 0.4
    tinted[1::2, 1::2] *= 0.2
    np.testing.assert_allclose(
        detect_corners(tinted, "RGGB", BOARDS).image_points, detect_corners(grey, "", BOARDS).image_points, atol=0.02
    )


def test_a_checkerboard_is_found_the_right_way_round_even_upside_down():
    for turn in (np.eye(3), np.diag([-1.0, -1.0, 1.0])):
        rotation, translation = turn @ POSES[1][0], turn @ POSES[1][1]
        corners = detect_corners(photograph(rotation, translation, (CHECKER,)), "", (CHECKER,))
        assert len(corners) == 54
        off = corners.image_points - project(corners_of(CHECKER)[corners.corner], rotation, translation)
        assert np.abs(off).max() < 0.05


@pytest.mark.parametrize("legacy", [False, True])
def test_the_pattern_of_older_opencv_is_told_from_the_new_one(legacy: bool):
    corners = detect_corners(photograph(*POSES[1], legacy=legacy), "", BOARDS)
    assert corners.legacy == (frozenset({0, 1}) if legacy else frozenset())
    off = corners.image_points - project(TRUE[corners.corner], *POSES[1])
    assert len(corners) == 50
    assert np.abs(off).max() < 0.05


def test_a_picture_without_boards_has_no_corners():
    nothing = detect_corners(np.full((HEIGHT, WIDTH), 128, np.float32), "", (*BOARDS, CHECKER))
    assert len(nothing) == 0
    assert not usable_views([nothing]).any()


def test_a_board_that_the_rig_does_not_have_is_not_taken_for_another():
    picture = photograph(*POSES[0], boards=(RIGHT,))
    assert len(detect_corners(picture, "", (LEFT,))) == 0
    np.testing.assert_array_equal(detect_corners(picture, "", BOARDS).corner, np.arange(25, 50))


def test_a_board_half_hidden_gives_the_corners_that_show():
    picture = photograph(*POSES[0])
    picture[:, :190] = 0.0
    corners = detect_corners(picture, "", BOARDS)
    assert 25 < len(corners) < 50
    off = corners.image_points - project(TRUE[corners.corner], *POSES[0])
    assert np.abs(off).max() < 0.1


def test_corners_under_clipped_pixels_are_not_moved_by_them():
    picture = photograph(*POSES[0])
    clean = detect_corners(picture, "", BOARDS)
    x, y = clean.image_points[10].round().astype(int)
    picture[y - 6 : y - 3, x - 6 : x + 6] = np.nan
    off = detect_corners(picture, "", BOARDS).image_points[10] - clean.image_points[10]
    assert np.abs(off).max() < 0.02


def test_the_mosaic_of_a_neutral_board_does_not_show_in_the_picture_for_detection():
    grey = photograph(*POSES[0])
    mosaic = grey.copy()
    mosaic[0::2, 0::2] *= 0.4
    mosaic[1::2, 1::2] *= 0.2
    plain, balanced = detection_image(grey, ""), detection_image(mosaic, "RGGB")
    assert np.percentile(np.abs(plain.astype(int) - balanced), 99) <= 2


@pytest.mark.parametrize("squares", [(4, 4), (5, 7), (4, 6)])
@pytest.mark.parametrize("legacy", [False, True])
def test_the_print_is_drawn_as_opencv_draws_it(squares: tuple[int, int], legacy: bool):
    # At a size at which OpenCV need not round: 6 pixels a bit.
    board = Board("charuco", "DICT_4X4_50", 3, squares, 2.4, 1.8, (0.0, 0.0))
    np.testing.assert_allclose(pattern(board, 48, legacy), printed(board, legacy) / 255.0, atol=1e-6)


def test_board_coordinates_run_down_and_those_of_the_sample_up():
    layout = BoardLayout.nominal(BOARDS)
    np.testing.assert_allclose(layout.points(np.arange(50)), TRUE)


def test_four_points_of_which_three_lie_on_one_line_hold_no_homography() -> None:
    on_board = np.array([[16.5, 16.5], [16.5, 11.0], [16.5, 5.5], [11.0, 5.5]])
    in_picture = np.array([[590.2, 489.7], [597.4, 483.1], [607.5, 473.1], [583.9, 469.2]])
    assert np.isnan(_homography(on_board, in_picture)).all()
