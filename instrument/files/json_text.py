"""Parses JSON that a file from elsewhere holds, and bounds how deep values are nested."""

from __future__ import annotations

import json
from typing import Any

DEEPEST = 32
"""What halfangle writes is nested five deep; far more would be too deep for who goes through it."""

TOO_DEEP = f"nested deeper than {DEEPEST} times"


def parse_json(text: str) -> Any:
    """Return the values of `text`.

    Raises
    ------
    ValueError
        If it is not JSON, or nested deeper than `DEEPEST`.
    """
    try:
        value = json.loads(text)
    except RecursionError:
        raise ValueError(TOO_DEEP) from None
    refuse_deep(value)
    return value


def refuse_deep(value: Any) -> None:
    """Raise ValueError if dicts and lists are nested deeper than `DEEPEST`."""
    level = [value]
    for _ in range(DEEPEST):
        level = [inner for outer in level for inner in _within(outer)]
    if level:
        raise ValueError(TOO_DEEP)


def _within(value: Any) -> list[Any]:
    return list(value.values()) if isinstance(value, dict) else value if isinstance(value, list) else []
