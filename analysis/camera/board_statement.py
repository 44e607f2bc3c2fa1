"""Whether the markers that are seen lie where the stated boards have them, and which statement would fit."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.camera.board_detection import SeenMarkers, see_markers
from analysis.camera.board_pattern import marker_dictionary, marker_outlines, n_markers
from instrument.session.records import Board

Array = NDArray[np.float64]

Markers: TypeAlias = tuple[SeenMarkers, ...]

_FEWEST = 3
"""Markers of a board in a picture that can speak for or against what is stated: two fit nearly anything."""

# Of a marker's side: how far a lens may bend a board, while another statement is off by a square and more. And of a
# square's: within which a marker that is not stated belongs to the board's own print.
_TOLERANCE, _ON_GRID = 0.3, 0.15

_CLEARLY = 1.2  # times the markers of the other reading

MOST = 0.8
"""Share of the markers of a print below which it is not the board that is stated."""

_FITS = 0.9

_SIDES = range(2, 26)  # squares of a board

_TRIALS = 300


@dataclass(frozen=True, slots=True)
class MarkerEvidence:
    """What the markers say of a stated board.

    Attributes
    ----------
    n_seen : int
        Markers of the board in all pictures, and those on the grid of its squares that it is not stated to have.
    n_explained : int
        Those that lie where the stated board has them.
    fits : Board or None
        A board that explains them, where the stated one does not.
    """

    n_seen: int
    n_explained: int
    fits: Board | None

    @property
    def share(self) -> float:
        """Share of the markers that the statement explains; 1 where none is seen."""
        return self.n_explained / self.n_seen if self.n_seen else 1.0


def old_patterns(boards: Sequence[Board], views: Sequence[Markers]) -> dict[int, bool]:
    """Tell which boards have the pattern of OpenCV before its version 4.6, from the markers of several pictures.

    Parameters
    ----------
    boards : sequence of Board
    views : sequence of tuple of SeenMarkers
        Of each picture, one a dictionary.

    Returns
    -------
    dict of int to bool
        Without boards of which the markers tell nothing.
    """
    told = {}
    for index, board in enumerate(boards):
        if board.kind == "charuco" and board.squares[1] % 2 == 0:
            new, old = (_n_explained(board, legacy, [_of(board, view) for view in views]) for legacy in (False, True))
            if max(new, old) > _CLEARLY * min(new, old):
                told[index] = old > new
    return told


def marker_evidence(
    boards: Sequence[Board], views: Sequence[Markers], legacy: frozenset[int]
) -> tuple[MarkerEvidence | None, ...]:
    """Judge each stated board by the markers of all pictures; None for a checkerboard.

    Parameters
    ----------
    boards : sequence of Board
    views : sequence of tuple of SeenMarkers
        Of each picture, one a dictionary.
    legacy : frozenset of int
        Boards with the pattern of OpenCV before its version 4.6.
    """
    return tuple(
        None if board.kind == "checkerboard" else _judge(boards, index, views, index in legacy)
        for index, board in enumerate(boards)
    )


def other_board(evidence: MarkerEvidence | None) -> str:
    """Say which board the markers fit instead of the stated one; nothing where that explains them."""
    if evidence is None or evidence.fits is None:
        return ""
    return f"the markers fit squares = {list(evidence.fits.squares)}, first_id = {evidence.fits.first_id}"


def mirrored(image: NDArray[np.uint8], boards: Sequence[Board]) -> bool:
    """Tell whether a picture shows more of the boards' markers when it is seen in a mirror."""
    return _n_of_boards(np.ascontiguousarray(image[:, ::-1]), boards) > max(_n_of_boards(image, boards), _FEWEST - 1)


def counted_by_inner_corners(image: NDArray[np.uint8], board: Board) -> bool:
    """Tell whether a checkerboard has as many inner corners as it is stated to have squares."""
    return bool(cv2.findChessboardCornersSB(image, board.squares, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)[0])


def _n_of_boards(image: NDArray[np.uint8], boards: Sequence[Board]) -> int:
    view = see_markers(image, boards)
    return sum(int(_ours(board, _of(board, view)).sum()) for board in boards if board.kind == "charuco")


def _judge(boards: Sequence[Board], index: int, views: Sequence[Markers], legacy: bool) -> MarkerEvidence:
    board = boards[index]
    others = [b for k, b in enumerate(boards) if k != index and b.dictionary == board.dictionary]
    pool = [_without(_of(board, view), others) for view in views]
    pool = [seen for seen in pool if _ours(board, seen).sum() >= _FEWEST]
    n_explained = _n_explained(board, legacy, pool)
    n_seen = sum(_n_on_print(board, legacy, seen) for seen in pool)
    if n_explained >= MOST * n_seen:
        return MarkerEvidence(n_seen, n_explained, None)
    return MarkerEvidence(n_seen, n_explained, _fitting(board, legacy, pool))


def _fitting(board: Board, legacy: bool, pool: Sequence[SeenMarkers]) -> Board | None:
    """Return the board like the stated one, but for squares and first number, that explains the markers; else None."""
    number, count = np.unique(np.concatenate([seen.ids for seen in pool]), return_counts=True)
    number = number[count >= 0.2 * count.max()]  # what was misread now and then is no marker
    pool = [_only(seen, np.isin(seen.ids, number)) for seen in pool]
    candidates = list(product(_boards_with(board, number), (legacy, not legacy)))
    clearest = [max(pool, key=lambda seen: len(seen.ids))]
    explains = [_n_explained(*candidate, clearest) for candidate in candidates]
    if not any(explains):  # no board holds all numbers, as where one was misread, or none explains them
        return None
    best = [c for c, n in zip(candidates, explains, strict=True) if n >= _FITS * max(explains)]

    def rank(candidate: tuple[Board, bool]) -> tuple[float, ...]:
        other, old = candidate
        likely = other.squares in (board.squares, board.squares[::-1], tuple(n + 1 for n in board.squares))
        n_unseen = n_markers(other) - len(number)
        return (-_n_explained(other, old, pool), not likely, n_unseen, other.first_id != board.first_id, old != legacy)

    chosen = min(best, key=rank)
    enough = _n_explained(*chosen, pool) >= _FITS * sum(len(seen.ids) for seen in pool)
    return chosen[0] if enough else None


def _boards_with(board: Board, ids: NDArray[np.int64]) -> Iterator[Board]:
    """Yield boards like the stated one, with other squares and first numbers, that hold all markers."""
    for first_id, squares in product(sorted({board.first_id, int(ids.min())}), product(_SIDES, _SIDES)):
        other = replace(board, first_id=first_id, squares=squares)
        if first_id <= ids.min() and ids.max() < first_id + n_markers(other) <= _n_in_dictionary(board):
            yield other


def _n_in_dictionary(board: Board) -> int:
    return len(marker_dictionary(board.dictionary).bytesList)


def _n_explained(board: Board, legacy: bool, pool: Sequence[SeenMarkers]) -> int:
    return sum(int(_fit(board, legacy, seen)[1].sum()) for seen in pool)


def _fit(board: Board, legacy: bool, seen: SeenMarkers) -> tuple[Array | None, NDArray[np.bool_]]:
    """Return the homography from board to picture that most of the board's markers share, and which of them do."""
    ours = _ours(board, seen)
    if ours.sum() < _FEWEST:
        return None, np.zeros(int(ours.sum()), bool)
    on_board, in_picture = marker_outlines(board, legacy)[seen.ids[ours] - board.first_id], seen.outlines[ours]
    side = float(np.median(np.linalg.norm(in_picture - np.roll(in_picture, 1, axis=1), axis=2)))
    H, inlier = cv2.findHomography(
        on_board.reshape(-1, 2), in_picture.reshape(-1, 2), cv2.RANSAC, _TOLERANCE * side, maxIters=_TRIALS
    )
    if H is None or np.linalg.det(H) <= 0.0:  # a board that faces the camera is not mirrored
        return None, np.zeros(int(ours.sum()), bool)
    return np.asarray(H, np.float64), np.asarray(np.asarray(inlier, bool).reshape(-1, 4).all(axis=1))


def _n_on_print(board: Board, legacy: bool, seen: SeenMarkers) -> int:
    """Return how many markers are the board's by number, or lie on the grid of its squares, not far from it."""
    ours = _ours(board, seen)
    H, _ = _fit(board, legacy, seen)
    if H is None or ours.all():
        return int(ours.sum())
    at = cv2.perspectiveTransform(seen.outlines[~ours].reshape(-1, 1, 2), np.linalg.inv(H)).reshape(-1, 4, 2)
    in_squares = at.mean(axis=1) / board.square_mm
    off_grid = np.abs(in_squares - np.floor(in_squares) - 0.5).max(axis=1)
    sides = np.linalg.norm(at - np.roll(at, 1, axis=1), axis=2) / board.marker_mm
    squares = np.array(board.squares)
    near = ((in_squares > -squares) & (in_squares < 2 * squares)).all(axis=1)
    on_grid = near & (off_grid < _ON_GRID) & (np.abs(sides - 1.0).max(axis=1) < _TOLERANCE)
    return int(ours.sum() + on_grid.sum())


def _of(board: Board, view: Markers) -> SeenMarkers:
    return next(seen for seen in view if seen.dictionary == board.dictionary)


def _ours(board: Board, seen: SeenMarkers) -> NDArray[np.bool_]:
    return np.asarray((seen.ids >= board.first_id) & (seen.ids < board.first_id + n_markers(board)))


def _without(seen: SeenMarkers, boards: Sequence[Board]) -> SeenMarkers:
    return _only(seen, ~np.any([np.zeros(len(seen.ids), bool), *(_ours(b, seen) for b in boards)], axis=0))


def _only(seen: SeenMarkers, keep: NDArray[np.bool_]) -> SeenMarkers:
    return replace(seen, ids=seen.ids[keep], outlines=seen.outlines[keep])
