import numpy as np

from analysis.white_areas import border_points, white_points
from instrument.records import Board
from tests.analysis.board_pictures import LEFT, PER_MM, printed


def test_white_points_are_white_on_the_print():
    points = white_points(LEFT, 0.5, 0.3)
    picture = printed(LEFT)
    columns = ((points[:, 0] - LEFT.corner_mm[0]) * PER_MM).astype(int)
    rows = ((LEFT.corner_mm[1] - points[:, 1]) * PER_MM).astype(int)
    assert len(points) > 100
    for di in (-4, 0, 4):
        for dj in (-4, 0, 4):
            assert np.all(picture[rows + di, columns + dj] == 255)


def test_border_points_keep_clear_of_boards_and_area():
    boards = (LEFT, Board("charuco", "DICT_4X4_100", 18, (6, 6), 6.0, 4.5, (40.0, 18.0)))
    points = border_points(boards, (20.0, 20.0), 2.5, 4.0)
    assert len(points) > 10
    x, y, _ = points.T
    assert not np.any((np.abs(x) < 14.0) & (np.abs(y) < 14.0))
    for board in boards:
        left, top = board.corner_mm
        assert not np.any((x > left - 4.0) & (x < left + 40.0) & (y < top + 4.0) & (y > top - 40.0))
