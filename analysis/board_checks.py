"""Checks of the boards: pattern, size of the squares, flatness, place."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from analysis.board_findings import BoardFindings
from analysis.checks import Check, Limits, Status, graded
from instrument.records import Board

FLATNESS = Limits(0.1, 1.0, "at most 0.1 mm; FAIL above 1 mm")
PLACE = Limits(0.5, np.inf, "at most 0.5 mm from where it was stated to lie")

_SCALE, _SIGMAS = 0.003, 3.0


def board_checks(boards: BoardFindings, stated: tuple[Board, ...]) -> Iterator[Check]:
    """Yield pattern, scale, flatness and place of the boards."""
    yield _pattern(boards)
    if np.isfinite(boards.scale):
        yield _scale(boards, stated)
    worst = int(boards.out_of_plane.argmax())
    flat = float(boards.out_of_plane[worst])
    remedy = f"glue board {worst} to something flat; its shape is taken into account, with its sigma"
    number = f"{flat:.4f} mm out of plane at the worst, on board {worst}"
    yield graded("flatness of the boards", flat, FLATNESS, number, remedy)
    if len(boards.moved) > 1:
        far = int(boards.moved.argmax())
        number = f"board {far} lies {boards.moved[far]:.3f} mm from its stated place"
        remedy = f"measure corner_mm of board {far} again, or state it as to be measured; the place found is used"
        yield graded("place of the boards", float(boards.moved[far]), PLACE, number, remedy)


def _pattern(boards: BoardFindings) -> Check:
    legacy = ", ".join(map(str, sorted(boards.legacy)))
    number = f"boards {legacy} have the pattern of OpenCV before 4.6" if legacy else "as OpenCV draws it since 4.6"
    return Check("pattern of the boards", Status.PASS, f"{number}; the pattern found is used", 0.0, "told", "")


def _scale(boards: BoardFindings, stated: tuple[Board, ...]) -> Check:
    """Judge the distances between boards: beyond chance it warns, beyond chance and 0.3 % it fails."""
    off = abs(boards.scale - 1.0)
    by_chance = _SIGMAS * boards.scale_sigma
    squares = ", ".join(sorted({f"{b.square_mm / boards.scale:.3f}" for b in stated}))
    printed = ", ".join(sorted({f"{b.square_mm:g}" for b in stated}))
    return graded(
        "scale of the squares",
        off,
        Limits(by_chance, max(by_chance, _SCALE), f"within {_SIGMAS:g} sigma; FAIL beyond that and 0.3 %"),
        f"{boards.scale:.5f} ± {boards.scale_sigma:.5f} of the stated distances between the boards",
        f"if the stated places are right, the squares measure {squares} mm, not {printed}: measure ten in a row "
        "and state square_mm; all lengths follow it",
    )
