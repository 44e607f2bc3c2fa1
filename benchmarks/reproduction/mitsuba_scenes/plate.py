"""The white plate round the relief, with a marker board in each corner."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.reproduction.mitsuba_scenes.surfaces import HALF_WIDTH_MM
from instrument.session.records import Board

HALF_PLATE_MM = 48.0

AREA_MM = 44.0
"""Side of the square to be reconstructed; the boards lie outside it."""

_SQUARES, _SQUARE_MM, _MARKER_MM, _DICTIONARY = 4, 5.0, 4.0, "DICT_4X4_50"

_N_MARKERS = _SQUARES * _SQUARES // 2

_TEXELS_PER_MM = 12  # squares and the markers' bits are whole numbers of texels, so OpenCV's drawing is exact

_PAPER, _INK = 0.8, 0.04

_OUTER_MM = 45.0


def boards() -> tuple[Board, ...]:
    """Return the four boards, their corners in the sample frame."""
    inner = _OUTER_MM - _SQUARES * _SQUARE_MM
    corners = [(-_OUTER_MM, _OUTER_MM), (inner, _OUTER_MM), (-_OUTER_MM, -inner), (inner, -inner)]
    return tuple(
        Board("charuco", _DICTIONARY, _N_MARKERS * k, (_SQUARES, _SQUARES), _SQUARE_MM, _MARKER_MM, corner)
        for k, corner in enumerate(corners)
    )


def print_on_plate() -> NDArray[np.uint8]:
    """Return the plate's linear albedo times 255, row 0 at the top, with OpenCV's own drawing of the boards."""
    side = round(2 * HALF_PLATE_MM * _TEXELS_PER_MM)
    plate = np.full((side, side), round(255 * _PAPER), np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, _DICTIONARY))
    n = round(_SQUARES * _SQUARE_MM * _TEXELS_PER_MM)
    for board in boards():
        ids = np.arange(board.first_id, board.first_id + _N_MARKERS)
        drawn = cv2.aruco.CharucoBoard(board.squares, board.square_mm, board.marker_mm, dictionary, ids)
        left, top = (round(d * _TEXELS_PER_MM) for d in (board.corner_mm[0], -board.corner_mm[1]))
        row, column = top + side // 2, left + side // 2
        paper = np.asarray(drawn.generateImage((n, n))) > 127
        plate[row : row + n, column : column + n] = np.where(paper, round(255 * _PAPER), round(255 * _INK))
    return plate


def ring() -> tuple[NDArray[np.float64], NDArray[np.int32]]:
    """Return vertices (8, 3), mm, and triangles (8, 3) of the plate with a square hole for the relief."""
    square = np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
    outline = np.concatenate([HALF_PLATE_MM * square, HALF_WIDTH_MM * square])
    faces = [[[k, (k + 1) % 4, 4 + (k + 1) % 4], [k, 4 + (k + 1) % 4, 4 + k]] for k in range(4)]
    return np.column_stack([outline, np.zeros(8)]), np.array(faces, np.int32).reshape(-1, 3)
