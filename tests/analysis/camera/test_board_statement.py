"""A board that is not what it was stated to be: pictures of one, read by the statement of another."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest

from analysis.camera.board_detection import SeenMarkers, detect_corners, detection_image, see_markers
from analysis.camera.board_statement import (
    MOST,
    counted_by_inner_corners,
    marker_evidence,
    mirrored,
    old_patterns,
    other_board,
)
from instrument.session.records import Board
from tests.analysis.board_pictures import BOARDS, CHECKER, POSES, corners_of, photograph, project

PRINTED = Board("charuco", "DICT_4X4_100", 4, (8, 6), 6.0, 4.5, (-24.0, 18.0))


@lru_cache
def views(legacy: bool = False, printed: Board = PRINTED) -> list[tuple[SeenMarkers, ...]]:
    pictures = (photograph(*pose, boards=(printed,), legacy=legacy) for pose in POSES[:3])
    return [see_markers(detection_image(picture, ""), (printed,)) for picture in pictures]


def stated(**changes: object) -> Board:
    return replace(PRINTED, **changes)


def test_a_board_as_stated_is_explained() -> None:
    (evidence,) = marker_evidence((PRINTED,), views(), frozenset())
    assert evidence is not None
    assert evidence.share == 1.0
    assert other_board(evidence) == ""


@pytest.mark.parametrize(
    "wrong",
    [
        stated(squares=(6, 8)),
        stated(squares=(7, 5)),  # its inner corners
        stated(squares=(9, 7)),
        stated(squares=(8, 4)),
        stated(first_id=3),
        stated(first_id=0),
        stated(first_id=12),  # two rows further: no marker contradicts another
    ],
)
def test_another_statement_is_refuted_and_the_one_that_fits_is_named(wrong: Board) -> None:
    (evidence,) = marker_evidence((wrong,), views(), frozenset())
    assert evidence is not None
    assert evidence.share < MOST
    assert evidence.fits is not None
    assert (evidence.fits.squares, evidence.fits.first_id) == (PRINTED.squares, PRINTED.first_id)
    assert other_board(evidence) == "the markers fit squares = [8, 6], first_id = 4"


def test_boards_beside_each_other_are_judged_each_by_its_own_markers() -> None:
    wrong = (replace(BOARDS[0], squares=(4, 9)), BOARDS[1])
    pictures = [see_markers(detection_image(photograph(*pose), ""), BOARDS) for pose in POSES[:2]]
    first, second = marker_evidence(wrong, pictures, frozenset())
    assert first is not None
    assert second is not None
    assert first.fits is not None
    assert first.fits.squares == (6, 6)
    assert second.share == 1.0


def test_a_marker_misread_now_and_then_refutes_nothing() -> None:
    misread = []
    for view in views():
        (seen,) = view
        ids = seen.ids.copy()
        ids[0] = 60 + len(misread)
        misread.append((replace(seen, ids=ids),))
    (evidence,) = marker_evidence((PRINTED,), misread, frozenset())
    assert evidence is not None
    assert evidence.share > 0.9


def test_numbers_that_no_board_has_are_fitted_by_none() -> None:
    """43 markers to the dictionary's end: no board of 2 to 25 squares a side has as many."""
    strange = [(replace(seen, ids=seen.ids[::-1] + 100 - 43 - seen.ids.min()),) for (seen,) in views()]
    strange = [(replace(s, ids=np.where(np.arange(len(s.ids)) == 0, 99, s.ids)),) for (s,) in strange]
    (evidence,) = marker_evidence((stated(first_id=57, squares=(7, 5)),), strange, frozenset())
    assert evidence is not None
    assert evidence.share < MOST
    assert evidence.fits is None


@pytest.mark.parametrize("legacy", [False, True])
def test_the_pattern_is_told_by_the_markers_of_all_pictures(legacy: bool) -> None:
    assert old_patterns((PRINTED,), views(legacy)) == {0: legacy}
    assert old_patterns((stated(squares=(8, 7)),), views(legacy)) == {}  # one and the same
    assert old_patterns((CHECKER,), views(legacy)) == {}


@pytest.mark.parametrize("legacy", [False, True])
@pytest.mark.parametrize("shown", [150.0, 235.0])
def test_clipped_paper_is_a_bound_and_hides_neither_pattern_nor_corners(legacy: bool, shown: float) -> None:
    rng = np.random.default_rng(8)
    picture = photograph(*POSES[1], boards=(PRINTED,), legacy=legacy) + rng.normal(0.0, 1.0, (480, 640)).astype("f4")
    clipped = picture >= shown
    corners = detect_corners(np.minimum(picture, np.float32(shown)), "", (PRINTED,), clipped=clipped)
    assert corners.legacy == (frozenset({0}) if legacy else frozenset())
    assert len(corners) == 35
    off = corners.image_points - project(corners_of(PRINTED)[corners.corner], *POSES[1])
    assert np.sqrt(np.mean(np.sum(off**2, axis=1))) < 0.05


@pytest.mark.parametrize("turned", [False, True])
def test_a_checkerboard_on_clipped_paper_is_found_the_right_way_round(turned: bool) -> None:
    turn = np.diag([-1.0, -1.0, 1.0]) if turned else np.eye(3)
    rotation, translation = turn @ POSES[1][0], turn @ POSES[1][1]
    picture = photograph(rotation, translation, (CHECKER,))
    clipped = picture >= 200.0
    corners = detect_corners(np.minimum(picture, np.float32(200.0)), "", (CHECKER,), clipped=clipped)
    off = corners.image_points - project(corners_of(CHECKER)[corners.corner], rotation, translation)
    assert len(corners) == 54
    assert np.abs(off).max() < 0.1


def test_mirrored_pictures_are_told() -> None:
    image = detection_image(photograph(*POSES[1]), "")
    assert not mirrored(image, BOARDS)
    assert mirrored(np.ascontiguousarray(image[:, ::-1]), BOARDS)
    assert not mirrored(np.full_like(image, 128), BOARDS)


def test_a_checkerboard_stated_by_its_inner_corners_is_told() -> None:
    image = detection_image(photograph(*POSES[1], boards=(CHECKER,)), "")
    assert counted_by_inner_corners(image, replace(CHECKER, squares=(9, 6)))
    assert not counted_by_inner_corners(image, CHECKER)
