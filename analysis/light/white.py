"""Radiances of white paper, view by view: what the powers and the fall-off of the light are found from."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.camera.board_layout import BoardLayout
from analysis.camera.board_pattern import pattern
from analysis.camera.view import View
from analysis.light.photometry import WhiteSamples
from analysis.registration.rectification import Rectified
from instrument.files.validation import InvalidInputError, Problem
from instrument.session.records import Board

Array = NDArray[np.float64]

_BOARD_SPACING_MM, _BORDER_SPACING_MM = 0.5, 2.5

_BOARD_CLEARANCE_PX = 1.5  # blur of the picture and of the resampling, in pixels of the picture

_BORDER_CLEARANCE_MM = 4.0  # room for a sample that lies askew or is larger than the area

_ENOUGH_BORDER = 50  # points: below, the border is not white or not there, and the boards' white must do

_TEXELS_PER_SQUARE = 96


@dataclass(frozen=True, slots=True)
class WhitePoints:
    """Points that should be white.

    Attributes
    ----------
    points : ndarray, shape (n_points, 3)
        Sample frame, mm.
    sheet : ndarray of int, shape (n_points,)
        The board each lies on; the last number is the border, which may not be white.
    """

    points: Array
    sheet: NDArray[np.int64]

    @classmethod
    def beside(
        cls,
        boards: tuple[Board, ...],
        layout: BoardLayout,
        legacy: frozenset[int],
        area_mm: tuple[float, float],
        footprint_mm: float,
    ) -> WhitePoints:
        """Choose them where the boards were found; `footprint_mm` is the size of a pixel on the sample."""
        clearance = _BOARD_CLEARANCE_PX * footprint_mm
        on_boards = [white_points(b, _BOARD_SPACING_MM, clearance, k in legacy) for k, b in enumerate(boards)]
        sheets = [layout.place(k, points) for k, points in enumerate(on_boards)]
        sheets.append(border_points(boards, layout, area_mm, _BORDER_SPACING_MM, _BORDER_CLEARANCE_MM))
        return cls(np.concatenate(sheets), np.repeat(np.arange(len(sheets)), [len(s) for s in sheets]))


def white_samples(
    seen: list[Rectified], white: WhitePoints, views: tuple[View, ...]
) -> tuple[WhiteSamples, NDArray[np.float32]]:
    """Return the samples that are white, and the level of each channel's white, shape (n_channels,).

    Parameters
    ----------
    seen : list of Rectified
        Each view resampled at the white points, shapes (1, n_points, ...).
    white : WhitePoints
    views : tuple of View

    Raises
    ------
    InvalidInputError
        If no white is seen unclipped.
    """
    radiance = np.stack([np.where(w.saturated[0] > 0, np.nan, w.radiance[0]) for w in seen])
    is_white = _are_white(radiance, white, views)
    if not np.isfinite(radiance[:, is_white]).any():
        problem = Problem("boards", "no white of the boards is seen unclipped; add a shorter exposure to the bracket")
        raise InvalidInputError("The light cannot be calibrated.", [problem])
    # Every channel's white is made 1, so that the three may be averaged and a neutral sample is neutral.
    level = np.nanmedian(radiance[:, is_white], axis=(0, 1))
    relative = (radiance / level).mean(axis=-1)
    with np.errstate(invalid="ignore"):
        i_view, i_point = np.nonzero((relative > 0.0) & is_white)
    samples = WhiteSamples(
        log_radiance=np.log(relative[i_view, i_point].astype(np.float64)),
        view=i_view,
        sheet=white.sheet[i_point],
        point=white.points[i_point],
        pixel=np.stack([w.pixels[0] for w in seen])[i_view, i_point],
    )
    return samples, np.asarray(level, np.float32)


def _are_white(radiance: NDArray[np.float32], white: WhitePoints, views: tuple[View, ...]) -> NDArray[np.bool_]:
    """Tell which points are white: the border's, if it is as bright as the boards' white, else the boards'.

    The border is preferred because a board's white is narrow and takes on black from its neighbours.
    """
    on_border = white.sheet == white.sheet.max()
    camera = np.stack([-view.rotation.T @ view.translation for view in views])
    to_camera = camera[:, None] - white.points
    # Freed of cos / d^2 of a collocated light: close enough to tell white from anything else.
    shading = to_camera[..., 2] / np.linalg.norm(to_camera, axis=-1) ** 3
    brightness = radiance.mean(axis=-1) / shading
    with np.errstate(invalid="ignore"), warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # a point that no view sees is no white point
        ratio = brightness / np.nanmedian(brightness[:, ~on_border], axis=1, keepdims=True)
        typical = np.nanmedian(ratio, axis=0)
        white_border = on_border & (typical > 0.85) & (typical < 1.5)
    return np.asarray(white_border if white_border.sum() >= _ENOUGH_BORDER else ~on_border)


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
        See `analysis.camera.board_pattern.charuco_board`.

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
