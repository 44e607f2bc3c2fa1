from dataclasses import replace

import numpy as np

from analysis.camera.board_layout import BoardLayout
from analysis.light.white import WhitePoints, border_points, white_points
from instrument.session.records import Board
from tests.analysis.board_pictures import LEFT, PER_MM, printed


def test_white_points_are_white_on_the_print():
    points = white_points(LEFT, 0.5, 0.3)
    picture = printed(LEFT)
    columns, rows = ((points + 18.0) * PER_MM).astype(int).T
    assert len(points) > 100
    for di in (-4, 0, 4):
        for dj in (-4, 0, 4):
            assert np.all(picture[rows + di, columns + dj] == 255)


def test_border_points_keep_clear_of_boards_and_area():
    boards = (LEFT, Board("charuco", "DICT_4X4_100", 18, (6, 6), 6.0, 4.5, (40.0, 18.0)))
    points = border_points(boards, BoardLayout.nominal(boards), (20.0, 20.0), 2.5, 4.0)
    assert len(points) > 10
    x, y, _ = points.T
    assert not np.any((np.abs(x) < 14.0) & (np.abs(y) < 14.0))
    for board in boards:
        left, top = board.corner_mm
        assert not np.any((x > left - 4.0) & (x < left + 40.0) & (y < top + 4.0) & (y > top - 40.0))


def test_white_is_looked_for_where_a_board_was_found_not_where_it_was_to_lie():
    unplaced = replace(LEFT, corner_mm=(np.nan, np.nan))
    turned = replace(
        BoardLayout.nominal((LEFT,)),
        rotation=np.array([[[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]]]),
        position=np.array([[3.0, -4.0, 0.1]]),
    )
    white = WhitePoints.beside((unplaced,), turned, frozenset(), (10.0, 10.0), 0.2)
    on_board = white.points[white.sheet == 0]
    # The board is a quarter turn round: its right runs up the sample, and its down to the right.
    clearance = white_points(LEFT, 0.5, 1.5 * 0.2)
    assert len(on_board) == len(clearance)
    expected = np.stack([3.0 + clearance[:, 1], -4.0 + clearance[:, 0], np.full(len(clearance), 0.1)], axis=1)
    np.testing.assert_allclose(on_board, expected, atol=1e-9)
