"""Where white paper lies beside the sample: between the boards, and in their white squares."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.board_layout import BoardLayout
from analysis.board_pattern import pattern
from instrument.records import Board

Array = NDArray[np.float64]

_TEXELS_PER_SQUARE = 96


def border_points(
    boards: Sequence[Board], layout: BoardLayout, area_mm: tuple[float, float], spacing_mm: float, clearance_mm: float
) -> Array:
    """Return points between the boards, outside the area, at least `clearance_mm` from either.

    The sheet that carries the boards is usually white there; whether it is, the pictures must tell.

    Returns
    -------
    ndarray, shape (n_points, 3)
        Sample frame, mm; none if the boards leave no room.
    """
    boxes = np.array([_extent(layout.place(k, _outline(board))) for k, board in enumerate(boards)])
    x = np.arange(boxes[:, 0].min() + clearance_mm, boxes[:, 1].max() - clearance_mm, spacing_mm)
    y = np.arange(boxes[:, 2].min() + clearance_mm, boxes[:, 3].max() - clearance_mm, spacing_mm)
    xx, yy = (a.ravel() for a in np.meshgrid(x, y))
    taken = (np.abs(xx) < area_mm[0] / 2 + clearance_mm) & (np.abs(yy) < area_mm[1] / 2 + clearance_mm)
    for left, right, bottom, top in boxes:
        taken |= (
            (left - clearance_mm < xx)
            & (xx < right + clearance_mm)
            & (bottom - clearance_mm < yy)
            & (yy < top + clearance_mm)
        )
    return np.asarray(np.stack([xx, yy, np.zeros_like(xx)], axis=1)[~taken])


def _outline(board: Board) -> Array:
    """Return the corners of a board from its centre, mm, shape (4, 2)."""
    half = 0.5 * board.square_mm * np.array(board.squares)
    return np.asarray(half * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]), np.float64)


def _extent(outline: Array) -> tuple[float, float, float, float]:
    """Return left, right, bottom, top of an outline in the sample frame, mm."""
    (left, bottom), (right, top) = outline[:, :2].min(axis=0), outline[:, :2].max(axis=0)
    return float(left), float(right), float(bottom), float(top)


def white_points(board: Board, spacing_mm: float, clearance_mm: float, legacy: bool = False) -> Array:
    """Return points of `board` that lie on white, at least `clearance_mm` from any black.

    Parameters
    ----------
    spacing_mm : float
        Distance of neighbouring points.
    clearance_mm : float
        Room for the blur of a picture.
    legacy : bool
        See `analysis.board_pattern.charuco_board`.

    Returns
    -------
    ndarray, shape (n_points, 2)
        From the board's centre, x right and y down, mm.
    """
    per_square = _TEXELS_PER_SQUARE
    per_mm = per_square / board.square_mm
    # What lies beyond the board's edge is not known, so the edge counts as black.
    white = np.pad((pattern(board, per_square, legacy) > 0.99).astype(np.uint8), 1)
    distance = cv2.distanceTransform(white, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1] / per_mm
    step = max(int(round(spacing_mm * per_mm)), 1)
    height, width = distance.shape
    rows, columns = np.meshgrid(np.arange(step // 2, height, step), np.arange(step // 2, width, step), indexing="ij")
    keep = distance[rows, columns] >= clearance_mm
    from_corner = (np.stack([columns[keep], rows[keep]], axis=1) + 0.5) / per_mm
    return np.asarray(from_corner - 0.5 * board.square_mm * np.array(board.squares), np.float64)
