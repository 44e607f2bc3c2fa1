"""What is printed on a marker board, as a picture: the reference that corners are measured against."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import cv2
import numpy as np
from numpy.typing import NDArray

from instrument.session.records import Board


def charuco_board(board: Board, legacy: bool = False) -> cv2.aruco.CharucoBoard:
    """Build OpenCV's description of `board`; `legacy` is the layout that OpenCV drew before its version 4.6."""
    dictionary = marker_dictionary(board.dictionary)
    ids = np.arange(board.first_id, board.first_id + n_markers(board))
    description = cv2.aruco.CharucoBoard(board.squares, board.square_mm, board.marker_mm, dictionary, ids)
    description.setLegacyPattern(legacy)
    return description


def n_markers(board: Board) -> int:
    """Return how many markers a ChArUco board has: one on every white square."""
    return board.squares[0] * board.squares[1] // 2


def marker_outlines(board: Board, legacy: bool = False) -> NDArray[np.float64]:
    """Return the corners of a ChArUco board's markers, from its top left corner as others, mm, shape (n, 4, 2)."""
    return np.asarray(charuco_board(board, legacy).getObjPoints(), np.float64)[..., :2]


def marker_dictionary(name: str) -> cv2.aruco.Dictionary:
    """Return OpenCV's predefined dictionary of that name."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def chessboard_corners(board: Board) -> NDArray[np.float64]:
    """Return the inner corners in the board's frame (x right, y down from its top left corner), mm, shape (n, 2)."""
    across, down = board.squares
    column, row = np.meshgrid(np.arange(1, across), np.arange(1, down))
    return np.asarray(np.stack([column.ravel(), row.ravel()], axis=1) * board.square_mm, np.float64)


@lru_cache(maxsize=64)
def pattern(board: Board, texels_per_square: int, legacy: bool = False) -> NDArray[np.float32]:
    """Draw a board, 0 = ink and 1 = paper, shape (down, across) times `texels_per_square`.

    Each texel is the share of it that is paper, exactly: OpenCV's own drawing rounds the edges of markers to
    whole pixels, which shifts corners by micrometres.

    Parameters
    ----------
    board : Board
    texels_per_square : int
    legacy : bool
        See `charuco_board`; means nothing for a checkerboard.
    """
    across, down = board.squares
    if board.kind == "checkerboard":
        row, column = np.divmod(np.arange(across * down), across)
        paper = ((row + column) % 2).reshape(down, across)
    else:
        paper = np.zeros((down, across))
    drawn = np.kron(paper, np.ones((texels_per_square, texels_per_square))).astype(np.float32)
    if board.kind == "charuco":
        for i, j, bits in _markers(board, legacy):
            down_it, across_it = (slice(k * texels_per_square, (k + 1) * texels_per_square) for k in (i, j))
            drawn[down_it, across_it] = _marker_square(bits, board.marker_mm / board.square_mm, texels_per_square)
    return drawn


def ink_rectangles(board: Board, legacy: bool = False) -> NDArray[np.float64]:
    """Return the black of a board as rectangles that do not overlap: left, top, right, bottom, mm, shape (n, 4).

    From the board's top left corner, x right and y down. Runs of black in a row of a marker are one rectangle.
    """
    across, down = board.squares
    row, column = np.divmod(np.arange(across * down), across)
    is_black = (row + column) % 2 == 0
    if board.kind == "charuco":
        is_black = np.ones(len(row), bool)
        is_black[[i * across + j for i, j, _ in _markers(board, legacy)]] = False
    corner = np.stack([column, row], axis=1)[is_black]
    squares = np.concatenate([corner, corner + 1], axis=1) * board.square_mm
    markers = _markers(board, legacy) if board.kind == "charuco" else ()
    return np.concatenate([squares, *(_marker_ink(board, i, j, bits) for i, j, bits in markers)])


def _marker_ink(board: Board, row: int, column: int, bits: NDArray[np.uint8]) -> NDArray[np.float64]:
    """Return the runs of black of the marker in a white square, as `ink_rectangles` does."""
    bit_mm = board.marker_mm / len(bits)
    edge = np.diff(np.pad(1 - bits.astype(int), ((0, 0), (1, 1))), axis=1)
    line, start = np.nonzero(edge == 1)
    _, end = np.nonzero(edge == -1)
    runs = np.stack([start, line, end, line + 1], axis=1) * bit_mm
    left_top = np.array([column, row]) * board.square_mm + 0.5 * (board.square_mm - board.marker_mm)
    return np.asarray(runs + np.tile(left_top, 2), np.float64)


def _markers(board: Board, legacy: bool) -> Iterator[tuple[int, int, NDArray[np.uint8]]]:
    """Yield row and column of each white square with the marker in it, 1 = paper, its black border included."""
    dictionary = marker_dictionary(board.dictionary)
    for number, outline in enumerate(marker_outlines(board, legacy), start=board.first_id):
        column, row = np.floor(outline.mean(axis=0) / board.square_mm).astype(int)
        bits = dictionary.getBitsFromByteList(dictionary.bytesList[number : number + 1], dictionary.markerSize)
        yield int(row), int(column), np.pad(np.asarray(bits, np.uint8), 1)


def _marker_square(bits: NDArray[np.uint8], side: float, n_texels: int) -> NDArray[np.float32]:
    """Draw a white square with a marker of the relative `side` in its middle, shape (n_texels, n_texels)."""
    edges = 0.5 + side * (np.arange(len(bits) + 1) / len(bits) - 0.5)
    texel = np.arange(n_texels + 1) / n_texels
    # Share of each texel (columns) that each bit (rows) covers, along one axis.
    low, high = np.maximum(edges[:-1, None], texel[:-1]), np.minimum(edges[1:, None], texel[1:])
    share = np.maximum(high - low, 0.0) * n_texels
    ink = share.T @ (1.0 - bits) @ share
    return np.asarray(1.0 - ink, np.float32)
