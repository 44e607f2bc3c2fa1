"""Boards, poses and pictures of them for tests, drawn with OpenCV and no code of the analysis."""

from __future__ import annotations

import cv2
import numpy as np

from instrument.session.records import Board

WIDTH, HEIGHT = 640, 480
MATRIX = np.array([[900.0, 0.0, 324.0], [0.0, 900.0, 235.0], [0.0, 0.0, 1.0]])
LEFT = Board("charuco", "DICT_4X4_100", 0, (6, 6), 6.0, 4.5, (-40.0, 18.0))
RIGHT = Board("charuco", "DICT_4X4_100", 18, (6, 6), 6.0, 4.5, (4.0, 18.0))
CHECKER = Board("checkerboard", "", 0, (10, 7), 6.0, 0.0, (-30.0, 21.0))
BOARDS = (LEFT, RIGHT)
PER_MM, SUPERSAMPLING = 20, 4


def pose(tilt_deg: float, azimuth_deg: float, roll_deg: float = 0.0) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation and translation, sample to camera, of a camera 160 mm from the centre that looks at it."""
    tilt, azimuth, roll = np.deg2rad([tilt_deg, azimuth_deg, roll_deg])
    centre = 160.0 * np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    forward = -centre / np.linalg.norm(centre)
    level = np.cross(forward, [0.0, 1.0, 0.0])
    level /= np.linalg.norm(level)
    right = np.cos(roll) * level + np.sin(roll) * np.cross(forward, level)
    rotation = np.stack([right, np.cross(forward, right), forward])
    return rotation, -rotation @ centre


POSES = [pose(0, 0), pose(25, 0, 20), pose(30, 72), pose(28, 144, -15), pose(32, 216), pose(22, 288, 30)]


def corners_of(board: Board) -> np.ndarray:
    """Return the inner corners in the sample frame, row by row from the top left, shape (n, 3), mm."""
    across, down = board.squares
    x, y = np.meshgrid(np.arange(1, across), np.arange(1, down))
    left, top = board.corner_mm
    return np.stack([left + x.ravel() * board.square_mm, top - y.ravel() * board.square_mm, 0.0 * x.ravel()], axis=1)


def project(points: np.ndarray, rotation: np.ndarray, translation: np.ndarray, distortion: tuple = (0,) * 5):
    """Return pixels (n, 2) by OpenCV."""
    vector = cv2.Rodrigues(rotation)[0]
    return cv2.projectPoints(points, vector, translation, MATRIX, np.array(distortion, float))[0].reshape(-1, 2)


def printed(board: Board, legacy: bool = False) -> np.ndarray:
    """Return the print, 0 and 255, `PER_MM` pixels a millimetre."""
    size = tuple(int(n * board.square_mm * PER_MM) for n in board.squares)
    if board.kind == "checkerboard":
        i, j = np.indices(size[::-1]) // int(board.square_mm * PER_MM)
        return (255 * ((i + j) % 2)).astype(np.uint8)
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    ids = np.arange(board.first_id, board.first_id + board.squares[0] * board.squares[1] // 2)
    described = cv2.aruco.CharucoBoard(board.squares, board.square_mm, board.marker_mm, dictionary, ids)
    described.setLegacyPattern(legacy)
    return described.generateImage(size)


def photograph(
    rotation: np.ndarray, translation: np.ndarray, boards: tuple[Board, ...] = BOARDS, legacy: bool = False
) -> np.ndarray:
    """Return a picture of the boards on a white sheet, each pixel the mean over its own square; 0 to 255."""
    size = (SUPERSAMPLING * WIDTH, SUPERSAMPLING * HEIGHT)
    # Pixel centres are integers, so a fine pixel i lies at (i + 1/2) / SUPERSAMPLING - 1/2 of the picture.
    k, half = float(SUPERSAMPLING), (SUPERSAMPLING - 1) / 2.0
    fine_from_pixel = np.array([[k, 0.0, half], [0.0, k, half], [0.0, 0.0, 1.0]])
    pixel_from_plane = MATRIX @ np.stack([rotation[:, 0], rotation[:, 1], translation], axis=1)
    fine = np.full(size[::-1], 255, np.uint8)
    for board in boards:
        x0, y0 = board.corner_mm
        plane_from_print = np.array(
            [[1.0 / PER_MM, 0.0, x0 + 0.5 / PER_MM], [0.0, -1.0 / PER_MM, y0 - 0.5 / PER_MM], [0.0, 0.0, 1.0]]
        )
        warp = fine_from_pixel @ pixel_from_plane @ plane_from_print
        print_ = printed(board, legacy)
        cv2.warpPerspective(print_, warp, size, fine, flags=cv2.INTER_LINEAR, borderMode=cv2.BORDER_TRANSPARENT)
    return cv2.resize(fine, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float32)
