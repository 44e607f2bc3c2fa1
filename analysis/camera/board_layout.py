"""Where the marker boards lie on the sample: as the rig file says, or as measured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.camera.board_pattern import chessboard_corners
from instrument.session.records import Board

Array = NDArray[np.float64]

_FLIP = np.diag([1.0, -1.0, -1.0])  # a board's y runs down, the sample's up


@dataclass(frozen=True, slots=True)
class BoardLayout:
    """Each board as a rigid body in the sample frame, about its own centre, and what its print is off by.

    Attributes
    ----------
    board : ndarray of int, shape (n_corners,)
        Which board each corner is on; the corners of all boards, one board after the other.
    arm : ndarray, shape (n_corners, 2)
        From the board's centre, board frame (x right, y down), mm.
    rotation : ndarray, shape (n_boards, 3, 3)
        Board (x right, y down, z away from the camera) to sample.
    position : ndarray, shape (n_boards, 3)
        Of the centre in the sample frame, mm; NaN = to be measured.
    displacement : ndarray, shape (n_corners, 3)
        Of each corner from where the print has it, sample frame, mm.
    """

    board: NDArray[np.int64]
    arm: Array
    rotation: Array
    position: Array
    displacement: Array

    @classmethod
    def nominal(cls, boards: Sequence[Board]) -> BoardLayout:
        """Return the layout as configured; a board without a place stays NaN."""
        centre = np.array([[0.5 * n * b.square_mm for n in b.squares] for b in boards]).reshape(-1, 2)
        corner = np.array([b.corner_mm for b in boards], np.float64).reshape(-1, 2)
        position = np.stack([corner[:, 0] + centre[:, 0], corner[:, 1] - centre[:, 1], 0.0 * corner[:, 0]], axis=1)
        grids = [chessboard_corners(b) - c for b, c in zip(boards, centre, strict=True)]
        board = np.repeat(np.arange(len(boards)), [len(g) for g in grids])
        arm = np.concatenate([np.zeros((0, 2)), *grids])
        rotation = np.broadcast_to(_FLIP, (len(boards), 3, 3)).copy()
        return cls(board, arm, rotation, position, np.zeros((len(arm), 3)))

    @property
    def placed(self) -> NDArray[np.bool_]:
        """Which boards have a place, shape (n_boards,)."""
        return np.asarray(np.isfinite(self.position).all(axis=1))

    def points(self, corner: NDArray[np.int64]) -> Array:
        """Return corners in the sample frame, mm, shape (n, 3)."""
        return np.asarray(self.arms(corner) + self.position[self.board[corner]] + self.displacement[corner])

    def arms(self, corner: NDArray[np.int64]) -> Array:
        """Return the way from its board's centre to each corner, in the sample frame, mm, shape (n, 3)."""
        return np.asarray(np.einsum("nij,nj->ni", self.rotation[self.board[corner], :, :2], self.arm[corner]))

    def place(self, board: int, from_centre: Array) -> Array:
        """Return points (n, 2) of a board, from its centre, x right and y down, in the sample frame, mm, (n, 3)."""
        return np.asarray(self.position[board] + from_centre @ self.rotation[board, :, :2].T)

    def moved(self, turn: Array, shift: Array, displacement: Array) -> BoardLayout:
        """Return the layout with each board turned by a rotation vector (n_boards, 3) and all else shifted, mm."""
        return replace(
            self,
            rotation=rotation_from_vector(turn) @ self.rotation,
            position=self.position + shift,
            displacement=self.displacement + displacement,
        )


def rotation_from_vector(vector: Array) -> Array:
    """Return rotation matrices (..., 3, 3) of rotation vectors (..., 3), rad [rodrigues1840]."""
    angle = np.linalg.norm(vector, axis=-1)[..., None, None]
    K = cross_matrix(vector)
    s = np.sinc(angle / np.pi)
    c = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2
    return np.asarray(np.eye(3) + s * K + c * (K @ K))


def cross_matrix(vector: Array) -> Array:
    """Return matrices (..., 3, 3) with K x = vector cross x."""
    x, y, z = np.moveaxis(vector, -1, 0)
    o = np.zeros_like(x)
    return np.stack([np.stack([o, -z, y], -1), np.stack([z, o, -x], -1), np.stack([-y, x, o], -1)], -2)
