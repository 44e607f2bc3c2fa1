"""A layout of boards around an area, for those who have none."""

from __future__ import annotations

from collections.abc import Iterator
from math import sqrt

from instrument.config.toml_text import board_lines, table_lines
from instrument.session.records import Board

PROPOSED_AREA_MM = (60.0, 60.0)

_SQUARES, _MARKERS = 4, 8

_SQUARE_SHARE = 5.5 / 60.0  # of the area's side

_SQUARE_LIMITS_MM = (2.0, 8.0)  # what printers print well, and what leaves room on a sheet

_MARKER_SHARE = 0.8

_GAP_MM = 2.0  # between the corners of the area and the boards


def proposed_boards(area_mm: tuple[float, float]) -> tuple[Board, ...]:
    """Return four ChArUco boards at the corners of an area about the origin; their squares grow with it."""
    least, most = _SQUARE_LIMITS_MM
    square = min(max(round(2.0 * _SQUARE_SHARE * sqrt(area_mm[0] * area_mm[1])) / 2.0, least), most)
    side = _SQUARES * square
    x, y = (0.5 * length + _GAP_MM for length in area_mm)
    corners = ((-x - side, y + side), (x, y + side), (-x - side, -y), (x, -y))
    return tuple(
        Board(
            kind="charuco",
            dictionary="DICT_4X4_50",
            first_id=_MARKERS * i,
            squares=(_SQUARES, _SQUARES),
            square_mm=square,
            marker_mm=round(_MARKER_SHARE * square, 6),
            corner_mm=corner,
        )
        for i, corner in enumerate(corners)
    )


def proposal_text(area_mm: tuple[float, float], printed: str) -> str:
    """Return the tables of that layout, to be copied; `printed` is the name of the file to print."""
    return "\n".join(_proposal(area_mm, printed)) + "\n"


def _proposal(area_mm: tuple[float, float], printed: str) -> Iterator[str]:
    yield f"# The boards of {printed}. Copy the tables into capture.toml; or [[boards]] into rig.toml, where the area"
    yield f"# is geometry.area_mm = [{float(area_mm[0])}, {float(area_mm[1])}]. Lengths are in mm."
    yield from table_lines("area", width_mm=float(area_mm[0]), height_mm=float(area_mm[1]))
    for board in proposed_boards(area_mm):
        yield from board_lines(board)
