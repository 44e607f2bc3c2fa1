"""Marker boards: where their corners lie on the sample, and where a picture shows them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from instrument.records import Board

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BoardCorners:
    """Chessboard corners of all boards found in one picture.

    Attributes
    ----------
    object_points : ndarray, shape (n_corners, 3)
        Sample frame, mm.
    image_points : ndarray, shape (n_corners, 2)
        Pixels, integer = centre of a pixel.
    board : ndarray of int, shape (n_corners,)
        Index of the board that each corner belongs to.
    """

    object_points: Array
    image_points: Array
    board: NDArray[np.int64]

    def __len__(self) -> int:
        return len(self.image_points)

    def select(self, keep: NDArray[np.bool_]) -> BoardCorners:
        """Return the corners where `keep` holds."""
        return BoardCorners(self.object_points[keep], self.image_points[keep], self.board[keep])


def charuco_board(board: Board) -> cv2.aruco.CharucoBoard:
    """Build OpenCV's description of `board`."""
    dictionary = _marker_dictionary(board.dictionary)
    ids = np.arange(board.first_id, board.first_id + _n_markers(board))
    return cv2.aruco.CharucoBoard(board.squares, board.square_mm, board.marker_mm, dictionary, ids)


def _n_markers(board: Board) -> int:
    """Return how many markers a board has: one on every white square."""
    return board.squares[0] * board.squares[1] // 2


def _marker_dictionary(name: str) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, name))


def sample_from_board(board: Board, points: Array) -> Array:
    """Return board coordinates (x right, y down, mm) in the sample frame (x right, y up, z out)."""
    x0, y0 = board.corner_mm
    return np.stack([x0 + points[:, 0], y0 - points[:, 1], np.zeros(len(points))], axis=1)


def detection_image(mosaic: NDArray[np.float32], bayer_pattern: str) -> NDArray[np.uint8]:
    """Return a full-resolution 8-bit picture in which neutral boards show no mosaic.

    Boards are printed in black on white, so scaling each colour of the mosaic to one white level makes
    every pixel a sample of the same luminance: no demosaicing, no shift between the colours.
    """
    balanced = mosaic.astype(np.float32)
    if bayer_pattern:
        for i in (0, 1):
            for j in (0, 1):
                balanced[i::2, j::2] /= max(float(np.percentile(mosaic[i::2, j::2], 95)), 1e-12)
    white = max(float(np.percentile(balanced, 97)), 1e-12)
    # A square root keeps the black squares of dim corners apart from the noise.
    return np.asarray(np.sqrt(np.clip(balanced / white, 0.0, 1.0)) * 255.0, np.uint8)


def detect_corners(image: NDArray[np.uint8], boards: Sequence[Board]) -> BoardCorners:
    """Find the chessboard corners of all `boards` in one picture; markers are searched once a dictionary.

    Parameters
    ----------
    image : ndarray of uint8, shape (height, width)
    boards : sequence of Board
        Their marker ids must not overlap within a dictionary.
    """
    found: list[tuple[Array, Array, int]] = []
    for name in sorted({board.dictionary for board in boards}):
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        detector = cv2.aruco.ArucoDetector(_marker_dictionary(name), parameters)
        marker_corners, marker_ids, _ = detector.detectMarkers(image)
        if marker_ids is None or len(marker_ids) == 0:
            continue
        flat_ids = np.asarray(marker_ids, np.int32).ravel()
        for index, board in enumerate(boards):
            ours = (flat_ids >= board.first_id) & (flat_ids < board.first_id + _n_markers(board))
            if board.dictionary == name and ours.any():
                corners = [c for c, mine in zip(marker_corners, ours, strict=True) if mine]
                found.append((*_board_corners(image, board, corners, flat_ids[ours]), index))
    return BoardCorners(
        np.concatenate([f[0] for f in found]) if found else np.zeros((0, 3)),
        np.concatenate([f[1] for f in found]) if found else np.zeros((0, 2)),
        np.concatenate([np.full(len(f[0]), f[2]) for f in found]) if found else np.zeros(0, np.int64),
    )


def _board_corners(
    image: NDArray[np.uint8],
    board: Board,
    marker_corners: Sequence[cv2.typing.MatLike],
    marker_ids: NDArray[np.int32],
) -> tuple[Array, Array]:
    description = charuco_board(board)
    detector = cv2.aruco.CharucoDetector(description)
    corners, ids, _, _ = detector.detectBoard(image, markerCorners=marker_corners, markerIds=marker_ids.reshape(-1, 1))
    if ids is None or len(ids) == 0:
        return np.zeros((0, 3)), np.zeros((0, 2))
    points = np.asarray(description.getChessboardCorners(), np.float64)[np.asarray(ids).ravel()]
    return sample_from_board(board, points), np.asarray(corners, np.float64).reshape(-1, 2)


def border_points(
    boards: Sequence[Board], area_mm: tuple[float, float], spacing_mm: float, clearance_mm: float
) -> Array:
    """Return points between the boards, outside the area, at least `clearance_mm` from either.

    The sheet that carries the boards is usually white there; whether it is, the pictures must tell.

    Returns
    -------
    ndarray, shape (n_points, 3)
        Sample frame, mm; none if the boards leave no room.
    """
    boxes = np.array([_extent(board) for board in boards])
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


def _extent(board: Board) -> tuple[float, float, float, float]:
    """Left, right, bottom, top of a board in the sample frame, mm."""
    x, y = board.corner_mm
    across, down = (n * board.square_mm for n in board.squares)
    return x, x + across, y - down, y


def white_points(board: Board, spacing_mm: float, clearance_mm: float) -> Array:
    """Return points of `board` that lie on white, at least `clearance_mm` from any black, in the sample frame.

    Parameters
    ----------
    spacing_mm : float
        Distance of neighbouring points.
    clearance_mm : float
        Room for the blur of a picture.

    Returns
    -------
    ndarray, shape (n_points, 3)
    """
    per_mm = 20
    size = tuple(int(round(n * board.square_mm * per_mm)) for n in board.squares)
    picture = charuco_board(board).generateImage(size)
    # What lies beyond the board's edge is not known, so the edge counts as black.
    white = np.pad((picture > 127).astype(np.uint8), 1)
    distance = cv2.distanceTransform(white, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)[1:-1, 1:-1] / per_mm
    step = max(int(round(spacing_mm * per_mm)), 1)
    rows, columns = np.meshgrid(np.arange(step // 2, size[1], step), np.arange(step // 2, size[0], step), indexing="ij")
    keep = distance[rows, columns] >= clearance_mm
    points = (np.stack([columns[keep], rows[keep]], axis=1) + 0.5) / per_mm
    return sample_from_board(board, points)
