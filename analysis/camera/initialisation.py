"""First estimate for the bundle adjustment: a plain lens, poses, and the places of boards that are not configured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.camera.board_detection import BoardCorners
from analysis.camera.board_layout import BoardLayout
from analysis.camera.bundle_adjustment import State
from analysis.camera.lens import Lens
from instrument.files.validation import InvalidInputError, Problem

Array = NDArray[np.float64]


def first_lens(
    corners: Sequence[BoardCorners], image_size: tuple[int, int], layout: BoardLayout, focal_length_px: float | None
) -> Lens:
    """Return a lens without distortion to start from; without a focal length, that of the boards' homographies."""
    width, height = image_size
    centre = np.array([(width - 1) / 2, (height - 1) / 2])
    f = focal_length_px or _focal_length(corners, image_size, layout)
    return Lens.of(np.array([[f, 0.0, centre[0]], [0.0, f, centre[1]], [0.0, 0.0, 1.0]]), np.zeros(5))


def _focal_length(corners: Sequence[BoardCorners], image_size: tuple[int, int], layout: BoardLayout) -> float:
    """Return a focal length in pixels from the homographies of single boards [zhang2000]."""
    on_board, in_picture = [], []
    for c in corners:
        board = layout.board[c.corner]
        of = board == np.bincount(board).argmax()
        on_board.append(np.pad(layout.arm[c.corner[of]], ((0, 0), (0, 1))).astype(np.float32))
        in_picture.append(c.image_points[of].astype(np.float32))
    matrix = cv2.initCameraMatrix2D(on_board, in_picture, image_size, 1.0)
    f = float(matrix[1, 1])
    return f if np.isfinite(f) and f > 0.0 else float(max(image_size))


def first_state(corners: Sequence[BoardCorners], lens: Lens, layout: BoardLayout) -> State:
    """Return poses of the views from the boards whose places are known, and places of those that are not.

    Raises
    ------
    InvalidInputError
        If a board without a place is never seen with one that has, or is the only one in a view.
    """
    placed = layout
    if not layout.placed.any() and len(layout.placed):
        # Any place will do for the first: the sample's frame is then that board's.
        position = layout.position.copy()
        position[0] = 0.0
        placed = replace(layout, position=position)
    poses: dict[int, tuple[Array, Array]] = {}
    while True:
        for v, c in enumerate(corners):
            if v not in poses and np.count_nonzero(placed.placed[placed.board[c.corner]]) >= 4:
                poses[v] = _pose(c, lens, placed)
        grown = _place_next(corners, lens, placed, poses)
        if grown is None:
            break
        placed = grown
    if len(poses) < len(corners):
        lost = sorted(set(range(len(corners))) - set(poses))
        problem = Problem(
            "boards",
            f"views {', '.join(map(str, lost))} show only boards whose place is to be measured and that no view shows "
            "together with another one; state corner_mm, or add pictures that show both.",
        )
        raise InvalidInputError("The boards cannot be placed.", [problem])
    order = range(len(corners))
    return State(lens, placed, np.stack([poses[v][0] for v in order]), np.stack([poses[v][1] for v in order]))


def _pose(corners: BoardCorners, lens: Lens, layout: BoardLayout) -> tuple[Array, Array]:
    """Return rotation and translation, sample to camera."""
    on = layout.placed[layout.board[corners.corner]]
    points = layout.points(corners.corner[on])
    # The plane's own frame keeps the solver away from the half turn between the sample's and the camera's axes.
    flip = np.diag([1.0, -1.0, -1.0])
    _, turn, shift = cv2.solvePnP(
        points @ flip, corners.image_points[on], lens.camera_matrix, lens.distortion, flags=cv2.SOLVEPNP_IPPE
    )
    _, turn, shift = cv2.solvePnP(
        points @ flip, corners.image_points[on], lens.camera_matrix, lens.distortion, turn, shift, True
    )
    return np.asarray(cv2.Rodrigues(turn)[0] @ flip, np.float64), np.asarray(np.ravel(shift), np.float64)


def _place_next(
    corners: Sequence[BoardCorners], lens: Lens, layout: BoardLayout, poses: dict[int, tuple[Array, Array]]
) -> BoardLayout | None:
    """Place one more board, from the view with a known pose that shows most of it; None if there is none."""
    best, at = 3, (-1, -1)
    for v in poses:
        counts = np.bincount(layout.board[corners[v].corner], minlength=len(layout.placed)) * ~layout.placed
        if counts.max(initial=0) > best:
            best, at = int(counts.max()), (v, int(counts.argmax()))
    v, b = at
    if v < 0:
        return None
    alone = replace(layout, position=np.where(np.arange(len(layout.placed))[:, None] == b, 0.0, np.nan))
    of = corners[v].select(layout.board[corners[v].corner] == b)
    R, t = _pose(of, lens, alone)
    R_v, t_v = poses[v]
    position, rotation = layout.position.copy(), layout.rotation.copy()
    position[b] = R_v.T @ (t - t_v)
    rotation[b] = R_v.T @ R @ layout.rotation[b]
    return replace(layout, rotation=rotation, position=position)
