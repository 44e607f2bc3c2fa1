"""Finds marker boards in a live picture, fast, and where they should be if they lie as configured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.camera.board_detection import board_readings, detection_image, see_markers
from analysis.camera.board_layout import BoardLayout
from analysis.camera.view import View
from instrument.session.records import Board

Array = NDArray[np.float64]

_MIN_POINTS = 8

_ONE_RADIAL_TERM = (
    cv2.CALIB_USE_INTRINSIC_GUESS
    | cv2.CALIB_FIX_PRINCIPAL_POINT
    | cv2.CALIB_FIX_FOCAL_LENGTH
    | cv2.CALIB_ZERO_TANGENT_DIST
    | cv2.CALIB_FIX_K2
    | cv2.CALIB_FIX_K3
)


@dataclass(frozen=True)
class SeenBoards:
    """The boards in one picture.

    Attributes
    ----------
    n_boards : int
        That show.
    found : ndarray, shape (n, 2)
        Corners of their markers (of a checkerboard, of its squares), pixels (x, y), integer = centre of a pixel.
    expected : ndarray, shape (m, 2)
        Where the corners of the squares of all boards with a stated place should be, by the pose that explains `found`
        best; empty where too little was found to tell.
    rms_px : float
        Distance of what was found on boards with a stated place from where it should be; NaN if that is not known.
    """

    n_boards: int
    found: Array
    expected: Array
    rms_px: float


def see_boards(
    counts: NDArray[np.uint16], bayer_pattern: str, boards: Sequence[Board], focal_length_px: float
) -> SeenBoards:
    """Find markers, to a tenth of a pixel or so, and fit the camera's pose and one radial term of its lens.

    A calibration finds corners ten times better, in a hundred times the time.

    Parameters
    ----------
    counts : ndarray of uint16, shape (H, W)
        Raw.
    bayer_pattern : str
        ``""`` for a monochrome frame.
    boards : sequence of Board
        As the rig states them.
    focal_length_px : float
        Nominal.

    References
    ----------
    [zhang2000] with one view: focal length and principal point are not to be had from it and stay nominal.
    """
    layout = BoardLayout.nominal(boards)
    image = detection_image(counts.astype(np.float32), bayer_pattern)
    found, at = [np.zeros((0, 2))], [np.zeros((0, 3))]
    for index, readings in board_readings(image, boards, see_markers(image, boards), {}):
        best = max(readings, key=lambda reading: len(reading.board_points))
        centre = 0.5 * boards[index].square_mm * np.array(boards[index].squares)
        found.append(best.image_points)
        at.append(layout.place(index, best.board_points - centre))
    return _explained(
        len(found) - 1, np.concatenate(found), np.concatenate(at), layout, (focal_length_px, counts.shape)
    )


def _explained(
    n_boards: int, found: Array, at: Array, layout: BoardLayout, camera: tuple[float, tuple[int, ...]]
) -> SeenBoards:
    """Return what was found with where it should be; `at` in the sample frame, mm, NaN without a stated place."""
    placed = np.isfinite(at).all(axis=1)
    if np.count_nonzero(placed) < _MIN_POINTS:
        return SeenBoards(n_boards, found, np.zeros((0, 2)), float("nan"))
    f, (height, width) = camera
    K = np.array([[f, 0.0, 0.5 * (width - 1)], [0.0, f, 0.5 * (height - 1)], [0.0, 0.0, 1.0]])
    points, seen = at[placed].astype(np.float32), found[placed].astype(np.float32)
    _, K, k, r, t = cv2.calibrateCamera([points], [seen], (width, height), K, np.zeros(5), flags=_ONE_RADIAL_TERM)
    rotation = cv2.Rodrigues(r[0])[0]
    view = View(*(np.asarray(a, np.float64) for a in (K, np.ravel(k), rotation, np.ravel(t[0]))))
    expected = view.project(layout.points(np.flatnonzero(layout.placed[layout.board])))
    off = view.project(at[placed]) - seen
    rms = float(np.sqrt(np.mean(np.sum(off**2, axis=1))))
    return SeenBoards(n_boards, found, expected, rms)
