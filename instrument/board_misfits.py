"""What boards may have against each other and against the area."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import combinations
from math import nan

from instrument.board_config import BoardConfig, Rectangle, overlap
from instrument.toml_lines import KeyPath


def board_misfits(
    boards: Mapping[int, BoardConfig], area: Rectangle | None, area_key: str
) -> Iterator[tuple[KeyPath, str]]:
    """Yield where and why boards do not fit each other or the area, which `area_key` of the file states.

    It takes those that are well formed by themselves, so that a mistake in one table does not hide
    another one between two others.
    """
    for i, board in boards.items():
        if overlap(board.rectangle, area):
            yield _at(i, "corner_mm", f"{_box(board)}, which overlaps {area_key}; move it outside")
    for (i, first), (j, second) in combinations(boards.items(), 2):
        if overlap(first.rectangle, second.rectangle):
            yield _at(j, "corner_mm", f"{_box(second)}, which overlaps boards[{i}] ({_box(first)})")
        yield from _shared_markers(i, first, j, second)


def _shared_markers(i: int, first: BoardConfig, j: int, second: BoardConfig) -> Iterator[tuple[KeyPath, str]]:
    shared = sorted(set(first.marker_ids) & set(second.marker_ids))
    if shared and first.dictionary == second.dictionary:
        yield _at(
            j,
            "first_id",
            f"the board's marker ids {second.marker_ids[0]} to {second.marker_ids[-1]} overlap those of "
            f"boards[{i}] ({first.marker_ids[0]} to {first.marker_ids[-1]}); "
            f"the next free id after that board is {first.marker_ids[-1] + 1}",
        )


def _at(i: int, key: str, text: str) -> tuple[KeyPath, str]:
    return ("boards", i, key), f"boards[{i}].{key}: {text}"


def _box(board: BoardConfig) -> str:
    left, bottom, right, top = board.rectangle or (nan,) * 4
    return f"the board covers x {left:g} to {right:g}, y {bottom:g} to {top:g} mm"
