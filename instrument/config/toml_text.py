"""Tables of a `capture.toml` as text."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from math import isfinite
from typing import Any

from instrument.session.records import Board


def board_lines(board: Board) -> Iterator[str]:
    """Yield the lines of one of `[[boards]]`."""
    yield from table_lines("[boards]", kind=board.kind, **_markers(board))
    yield from key_lines(squares=board.squares, square_mm=board.square_mm)
    yield from key_lines(corner_mm=board.corner_mm if board.is_placed else "measure")


def table_lines(name: str, **values: Any) -> Iterator[str]:
    """Yield an empty line, the table's head and its keys."""
    yield ""
    yield f"[{name}]"
    yield from key_lines(**values)


def key_lines(**values: Any) -> Iterator[str]:
    """Yield a line for each key that has a value: None, NaN and infinity are what nobody knows."""
    for key, value in values.items():
        if value is not None and not (isinstance(value, float) and not isfinite(value)):
            # Strings, numbers, lists and booleans of JSON are those of TOML, and floats keep all their digits.
            yield f"{key} = {json.dumps(value, ensure_ascii=False)}"


def _markers(board: Board) -> Mapping[str, Any]:
    if board.kind == "checkerboard":
        return {}
    return {"dictionary": board.dictionary, "first_id": board.first_id, "marker_mm": board.marker_mm}
