"""What a calibration finds of the boards: pattern, size of the squares, flatness, place."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.camera.board_layout import BoardLayout
from analysis.camera.board_statement import MarkerEvidence
from analysis.camera.bundle_adjustment import Bundle

Array = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class BoardFindings:
    """What was found of the boards.

    Attributes
    ----------
    legacy : frozenset of int
        Boards with the pattern that OpenCV drew before its version 4.6.
    scale, scale_sigma : float
        Distances between the boards, in units of their squares, over the distances stated; NaN where the
        stated layout explains the corners or there is one board only. Beside 1, the stated size of the
        squares or the stated places are wrong: the squares measure `square_mm` / scale.
    out_of_plane : ndarray, shape (n_boards,)
        Largest distance of a corner from its board's plane, mm.
    moved : ndarray, shape (n_boards,)
        How far each board lies from where it was to lie, mm.
    markers : tuple of MarkerEvidence or None
        For each board whether its markers are where it is stated to have them; None for a checkerboard. Empty where
        none was looked at.
    """

    legacy: frozenset[int]
    scale: float
    scale_sigma: float
    out_of_plane: Array
    moved: Array
    markers: tuple[MarkerEvidence | None, ...] = ()


def board_findings(
    bundle: Bundle, nominal: BoardLayout, legacy: frozenset[int], markers: tuple[MarkerEvidence | None, ...] = ()
) -> BoardFindings:
    """Compare the boards as found with the boards as stated.

    Parameters
    ----------
    bundle : Bundle
    nominal : BoardLayout
        As stated.
    legacy : frozenset of int
    markers : tuple of MarkerEvidence or None
    """
    layout = bundle.state.layout
    scale, sigma = _scale(bundle, nominal)
    n_boards = len(layout.position)
    out = np.array([_out_of_plane(layout, b) for b in range(n_boards)])
    moved = np.linalg.norm(layout.position - nominal.position, axis=1)
    return BoardFindings(legacy, scale, sigma, out, np.nan_to_num(moved), markers)


def _scale(bundle: Bundle, nominal: BoardLayout) -> tuple[float, float]:
    """Return the slope of found over stated places, both from their means, and its sigma."""
    if not bundle.freedom.boards.all() or not nominal.placed.all() or len(nominal.position) < 2:
        return float("nan"), float("nan")
    stated = nominal.position - nominal.position.mean(axis=0)
    found = bundle.state.layout.position - bundle.state.layout.position.mean(axis=0)
    weight = stated / np.sum(stated**2)
    first = len(bundle.freedom.lens) + np.arange(len(stated))[:, None] * 6 + [3, 4, 5]
    of_shifts = bundle.covariance[np.ix_(first.ravel(), first.ravel())]
    sigma = float(np.sqrt(weight.ravel() @ of_shifts @ weight.ravel()))
    return float(np.sum(weight * found)), sigma


def _out_of_plane(layout: BoardLayout, board: int) -> float:
    corner = np.flatnonzero(layout.board == board)
    points = layout.points(corner)
    if len(points) < 4:
        return 0.0
    centred = points - points.mean(axis=0)
    normal = np.linalg.svd(centred, full_matrices=False)[2][2]
    return float(np.abs(centred @ normal).max())
