"""Marker boards in a picture: which are there, and where their corners lie."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.camera.board_pattern import (
    chessboard_corners,
    marker_dictionary,
    marker_outlines,
    n_markers,
    pattern,
)
from analysis.camera.corner_refinement import Shown, align_corners, project
from analysis.camera.lens import Lens
from analysis.radiometry.mosaic import channel_of_cell
from instrument.session.records import Board

Array = NDArray[np.float64]

MISFIT = 0.25
"""RMS of the fit of the print, over its contrast, beyond which a corner is not believed."""

_TEXELS_PER_PX = 4.0

_TEXELS = (16, 32, 64, 128, 256)  # few sizes, so that drawings are reused

_MIN_POINTS = 4

_RANSAC_PX = 3.0  # a lens that bends a board does so by less

_N_NEAR = 16


@dataclass(frozen=True, slots=True)
class SeenMarkers:
    """Markers of one dictionary in one picture.

    Attributes
    ----------
    dictionary : str
    ids : ndarray of int, shape (n,)
    outlines : ndarray, shape (n, 4, 2)
        Their corners, pixels.
    """

    dictionary: str
    ids: NDArray[np.int64]
    outlines: Array


@dataclass(frozen=True, slots=True)
class BoardCorners:
    """Chessboard corners of all boards found in one picture.

    Attributes
    ----------
    corner : ndarray of int, shape (n_corners,)
        Which they are, counted through all boards as `analysis.camera.board_layout.BoardLayout` does.
    image_points : ndarray, shape (n_corners, 2)
        Pixels, integer = centre of a pixel.
    covariance : ndarray, shape (n_corners, 2, 2)
        Of the image points, from the noise of the picture, pixels squared.
    legacy : frozenset of int
        Boards whose pattern is that of OpenCV before its version 4.6.
    markers : tuple of SeenMarkers
        All that were seen, also such as no board is stated to have.
    """

    corner: NDArray[np.int64]
    image_points: Array
    covariance: Array
    legacy: frozenset[int] = frozenset()
    markers: tuple[SeenMarkers, ...] = ()

    def __len__(self) -> int:
        return len(self.image_points)

    def select(self, keep: NDArray[np.bool_]) -> BoardCorners:
        """Return the corners where `keep` holds."""
        return replace(
            self, corner=self.corner[keep], image_points=self.image_points[keep], covariance=self.covariance[keep]
        )


def detection_image(picture: NDArray[np.float32], bayer_pattern: str) -> NDArray[np.uint8]:
    """Return a full-resolution 8-bit picture in which neutral boards show no mosaic.

    Boards are printed in black on white, so scaling each colour of the mosaic to one white level makes
    every pixel a sample of the same luminance: no demosaicing, no shift between the colours.

    Parameters
    ----------
    picture : ndarray of float32, shape (height, width)
        Linear; NaN counts as white.
    bayer_pattern : str
        ``""`` for a monochrome picture.
    """
    balanced = np.nan_to_num(picture, nan=np.inf)
    if bayer_pattern:
        for i in (0, 1):
            for j in (0, 1):
                balanced[i::2, j::2] /= max(float(np.nanpercentile(picture[i::2, j::2], 95)), 1e-12)
    white = max(float(np.percentile(balanced[np.isfinite(balanced)], 97)), 1e-12)
    # A square root keeps the black squares of dim corners apart from the noise.
    return np.asarray(np.sqrt(np.clip(balanced / white, 0.0, 1.0)) * 255.0, np.uint8)


def detect_corners(
    picture: NDArray[np.float32],
    bayer_pattern: str,
    boards: Sequence[Board],
    lens: Lens | None = None,
    clipped: NDArray[np.bool_] | None = None,
    legacy: Mapping[int, bool] | None = None,
) -> BoardCorners:
    """Find the chessboard corners of all `boards` in one picture; markers are searched once a dictionary.

    Parameters
    ----------
    picture : ndarray of float32, shape (height, width)
        Linear, in the sensor's mosaic or monochrome; NaN where nothing is known.
    bayer_pattern : str
    boards : sequence of Board
        Their marker ids must not overlap within a dictionary.
    lens : Lens or None
        If it is known already; see `analysis.camera.corner_refinement.align_corners`.
    clipped : ndarray of bool, shape (height, width), or None
        Where the picture holds no more than a lower bound.
    legacy : mapping of int to bool, or None
        Boards of which it is known whether their pattern is that of OpenCV before its version 4.6; the others are
        tried both ways.
    """
    clipped = np.zeros(picture.shape, np.bool_) if clipped is None else clipped
    image = detection_image(np.where(clipped, np.float32(np.nan), picture), bayer_pattern)
    shown = Shown(picture, clipped, channel_of_cell(bayer_pattern))
    markers = see_markers(image, boards)
    first = np.cumsum([0, *((b.squares[0] - 1) * (b.squares[1] - 1) for b in boards)])
    found, old = [], set()
    for index, candidates in board_readings(image, boards, markers, legacy or {}):
        fits = [_fit_board(shown, boards[index], candidate, lens) for candidate in candidates]
        best = max(range(len(fits)), key=lambda k: len(fits[k]))
        if len(fits[best]):
            found.append(replace(fits[best], corner=fits[best].corner + first[index]))
            if candidates[best].legacy:
                old.add(index)
    return _joined(found, frozenset(old), markers)


@dataclass(frozen=True, slots=True)
class BoardReading:
    """Points of a board and where they seem to be in the picture, on one reading of the pattern.

    Attributes
    ----------
    legacy : bool
        Whether the pattern is that of OpenCV before its version 4.6.
    board_points : ndarray, shape (n, 2)
        From the board's top left corner, x right and y down, mm.
    image_points : ndarray, shape (n, 2)
        Pixels.
    """

    legacy: bool
    board_points: Array
    image_points: Array


def see_markers(image: NDArray[np.uint8], boards: Sequence[Board]) -> tuple[SeenMarkers, ...]:
    """Return all markers of the boards' dictionaries in a picture as `detection_image` returns it."""
    return tuple(_markers(image, name) for name in sorted({b.dictionary for b in boards if b.kind == "charuco"}))


def board_readings(
    image: NDArray[np.uint8],
    boards: Sequence[Board],
    markers: Sequence[SeenMarkers],
    legacy: Mapping[int, bool],
) -> Iterator[tuple[int, list[BoardReading]]]:
    """Yield the index of each board that shows, with every reading of it.

    Parameters
    ----------
    image : ndarray of uint8, shape (H, W)
        As `detection_image` returns it.
    boards : sequence of Board
    markers : sequence of SeenMarkers
        In that picture.
    legacy : mapping of int to bool
        As `detect_corners`.
    """
    of = {seen.dictionary: seen for seen in markers}
    for index, board in enumerate(boards):
        if board.kind == "checkerboard":
            readings = _checkerboard_readings(image, board)
        else:
            ways = (legacy[index],) if index in legacy else (False, True)
            readings = _charuco_readings(of[board.dictionary], board, ways)
        if readings:
            yield index, readings


def _markers(image: NDArray[np.uint8], dictionary: str) -> SeenMarkers:
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    corners, ids, _ = cv2.aruco.ArucoDetector(marker_dictionary(dictionary), parameters).detectMarkers(image)
    if ids is None or len(ids) == 0:
        return SeenMarkers(dictionary, np.zeros(0, np.int64), np.zeros((0, 4, 2)))
    outlines = np.asarray(corners, np.float64).reshape(-1, 4, 2)
    return SeenMarkers(dictionary, np.asarray(ids, np.int64).ravel(), outlines)


def _charuco_readings(seen: SeenMarkers, board: Board, ways: Sequence[bool]) -> list[BoardReading]:
    ours = (seen.ids >= board.first_id) & (seen.ids < board.first_id + n_markers(board))
    readings = []
    # With an odd number of rows the old pattern and the new one are the same.
    for legacy in ways[: 1 if board.squares[1] % 2 else 2]:
        on_board = marker_outlines(board, legacy)[seen.ids[ours] - board.first_id].reshape(-1, 2)
        in_picture = seen.outlines[ours].reshape(-1, 2)
        keep = _consistent(on_board, in_picture)
        readings.append(BoardReading(legacy, on_board[keep], in_picture[keep]))
    return [r for r in readings if len(r.board_points) >= _MIN_POINTS]


def _checkerboard_readings(image: NDArray[np.uint8], board: Board) -> list[BoardReading]:
    """Both ways round: which one it is, the sign of the contrast tells."""
    size = (board.squares[0] - 1, board.squares[1] - 1)
    shown, corners = cv2.findChessboardCornersSB(image, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not shown:
        shown, corners = cv2.findChessboardCorners(image, size)
    if not shown:
        return []
    grid, in_picture = chessboard_corners(board), np.asarray(corners, np.float64).reshape(-1, 2)
    return [BoardReading(False, grid, points) for points in (in_picture, in_picture[::-1])]


def _consistent(board_points: Array, image_points: Array) -> NDArray[np.bool_]:
    """Tell which points one homography explains: a marker that was misread is not among them."""
    if len(board_points) < _MIN_POINTS:
        return np.zeros(len(board_points), bool)
    H, inlier = cv2.findHomography(board_points, image_points, cv2.RANSAC, _RANSAC_PX)
    # A board that faces the camera is not mirrored.
    return np.asarray(inlier, bool).ravel() & bool(H is not None and np.linalg.det(H) > 0.0)


def _fit_board(shown: Shown, board: Board, candidate: BoardReading, lens: Lens | None) -> BoardCorners:
    """Fit the print twice: the corners found first lead to those that were missed."""
    grid = chessboard_corners(board)
    on_board, in_picture = candidate.board_points, candidate.image_points
    while True:
        H = _near_homographies(on_board, in_picture if lens is None else lens.undistort(in_picture), grid)
        known = np.flatnonzero(np.isfinite(H).all(axis=(1, 2)))
        if len(known) == 0:
            return BoardCorners(np.zeros(0, np.int64), np.zeros((0, 2)), np.zeros((0, 2, 2)))
        per_square = _texels_per_square(board, H)
        drawn = pattern(board, per_square, candidate.legacy)
        aligned = align_corners(
            shown, drawn, per_square / board.square_mm, H[known], grid[known], board.square_mm, lens
        )
        with np.errstate(invalid="ignore"):
            ok = (aligned.contrast > 0.0) & (aligned.misfit < MISFIT)
        found = BoardCorners(known[ok], aligned.points[ok], aligned.covariance[ok])
        if len(found) < _MIN_POINTS or on_board is not candidate.board_points:
            return found
        on_board, in_picture = grid[known[ok]], found.image_points


def _near_homographies(board_points: Array, image_points: Array, at: Array) -> Array:
    """Return for each of the points `at` the homography of the points next to it, shape (n, 3, 3).

    One for the whole board would not do: the lens bends it.
    """
    distance = np.linalg.norm(at[:, None] - board_points, axis=2)
    nearest = np.argsort(distance, axis=1, kind="stable")[:, :_N_NEAR]
    return np.stack([_homography(board_points[near], image_points[near]) for near in nearest])


def _homography(board_points: Array, image_points: Array) -> Array:
    H, _ = cv2.findHomography(board_points, image_points)
    # Points on one line hold no homography, nor do four of which three are; one that maps to nowhere is found out by
    # the fit.
    return np.full((3, 3), np.nan) if H is None or np.linalg.matrix_rank(H) < 3 else np.asarray(H, np.float64)


def _texels_per_square(board: Board, homographies: Array) -> int:
    """Return texels fine enough for the picture: several a pixel where the board is nearest."""
    grid = chessboard_corners(board)
    along = project(homographies, grid + np.array([board.square_mm, 0.0])) - project(homographies, grid)
    down = project(homographies, grid + np.array([0.0, board.square_mm])) - project(homographies, grid)
    wanted = _TEXELS_PER_PX * float(np.nanmax(np.linalg.norm(np.stack([along, down]), axis=2)))
    return next((n for n in _TEXELS if n >= wanted), _TEXELS[-1])


def _joined(found: Sequence[BoardCorners], legacy: frozenset[int], markers: tuple[SeenMarkers, ...]) -> BoardCorners:
    return BoardCorners(
        np.concatenate([np.zeros(0, np.int64), *(f.corner for f in found)]),
        np.concatenate([np.zeros((0, 2)), *(f.image_points for f in found)]),
        np.concatenate([np.zeros((0, 2, 2)), *(f.covariance for f in found)]),
        legacy,
        markers,
    )
