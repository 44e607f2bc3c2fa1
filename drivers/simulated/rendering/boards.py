"""The ink of the marker boards, as a texture that is filtered to the size of a camera's pixel."""

from __future__ import annotations

import math
from typing import NamedTuple, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.simulated.rendering.compiling import njit
from drivers.simulated.settings import BoardSettings

_FINE_PX_PER_SQUARE = 480

_PAD_TEXELS = 2


class Ink(NamedTuple):
    """Boards as coverage by ink.

    Attributes
    ----------
    texels : ndarray of float32, shape (n_boards, height, width)
        0 = paper, 1 = ink, with `_PAD_TEXELS` of paper round each board.
    frames : ndarray, shape (n_boards, 5)
        Left, top, width and height in mm, sample frame, and texels per mm.
    """

    texels: NDArray[np.float32]
    frames: NDArray[np.float64]


def charuco_board(board: BoardSettings) -> cv2.aruco.CharucoBoard:
    """Return OpenCV's board, new pattern, lengths in mm."""
    dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary))
    n_markers = board.squares[0] * board.squares[1] // 2
    ids = np.arange(board.first_id, board.first_id + n_markers, dtype=np.int32)
    return cv2.aruco.CharucoBoard(board.squares, board.square_mm, board.marker_mm, dictionary, ids)


def corners_mm(board: BoardSettings) -> NDArray[np.float64]:
    """Return the inner chessboard corners in the sample frame, shape (n, 3), in OpenCV's order."""
    corners = np.array(charuco_board(board).getChessboardCorners(), dtype=np.float64)
    left, top = board.corner_mm
    return np.column_stack([left + corners[:, 0], top - corners[:, 1], np.zeros(len(corners))])


def _board_ink(board: BoardSettings, texels_per_square: int) -> NDArray[np.float32]:
    across, down = board.squares
    # Drawn so fine that OpenCV's rounding to whole pixels does not show, then averaged over each texel.
    fine_size = (across * _FINE_PX_PER_SQUARE, down * _FINE_PX_PER_SQUARE)
    fine = charuco_board(board).generateImage(fine_size).astype(np.float32)
    size = (across * texels_per_square, down * texels_per_square)
    paper = cv2.resize(fine, size, interpolation=cv2.INTER_AREA) / 255.0
    return cast("NDArray[np.float32]", np.pad(1.0 - paper, _PAD_TEXELS))


def draw_boards(boards: tuple[BoardSettings, ...], pixel_mm: float) -> Ink:
    """Return the ink of all boards.

    Parameters
    ----------
    boards : tuple of BoardSettings
        What is printed where.
    pixel_mm : float
        Size of a camera pixel on the sample; texels are about half of it, so that they neither blur
        the edges nor let them alias.
    """
    textures, frames = [], []
    for board in boards:
        per_square = min(max(math.ceil(2.0 * board.square_mm / pixel_mm), 8), _FINE_PX_PER_SQUARE)
        textures.append(_board_ink(board, per_square))
        frames.append((*board.corner_mm, *board.size_mm, per_square / board.square_mm))
    height = max((t.shape[0] for t in textures), default=1)
    width = max((t.shape[1] for t in textures), default=1)
    texels = np.zeros((len(textures), height, width), dtype=np.float32)
    for k, texture in enumerate(textures):
        texels[k, : texture.shape[0], : texture.shape[1]] = texture
    return Ink(texels, np.array(frames, dtype=np.float64).reshape(-1, 5))


@njit(cache=True, nogil=True, error_model="numpy")
def board_at(ink: Ink, x: float, y: float, margin: float) -> int:
    """Return the board that covers a point or comes within `margin` mm of it, or -1."""
    for k in range(ink.frames.shape[0]):
        right, down = x - ink.frames[k, 0], ink.frames[k, 1] - y
        if -margin < right < ink.frames[k, 2] + margin and -margin < down < ink.frames[k, 3] + margin:
            return k
    return -1


@njit(cache=True, nogil=True, error_model="numpy")
def ink_at(ink: Ink, x: float, y: float) -> float:
    """Return the coverage by ink at a point of the plate, bilinear between texels."""
    margin = 0.0 if ink.frames.shape[0] == 0 else 1.0 / ink.frames[0, 4]
    k = board_at(ink, x, y, margin)
    if k < 0:
        return 0.0
    scale = ink.frames[k, 4]
    # Texel centres stand at half-integer places of the board.
    u = (x - ink.frames[k, 0]) * scale - 0.5 + _PAD_TEXELS
    v = (ink.frames[k, 1] - y) * scale - 0.5 + _PAD_TEXELS
    i, j = int(u), int(v)
    s, t = u - i, v - j
    texels = ink.texels
    if not (u >= 0.0 and v >= 0.0 and i + 1 < texels.shape[2] and j + 1 < texels.shape[1]):
        return 0.0
    upper = texels[k, j, i] * (1.0 - s) + texels[k, j, i + 1] * s
    lower = texels[k, j + 1, i] * (1.0 - s) + texels[k, j + 1, i + 1] * s
    return float(upper * (1.0 - t) + lower * t)
