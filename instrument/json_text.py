"""Parses JSON that a file from elsewhere holds."""

from __future__ import annotations

import json
from typing import Any

DEEPEST = 32
"""What halfangle writes is nested five deep; far more would be too deep for who goes through it."""


def parse_json(text: str) -> Any:
    """Return the values of `text`.

    Raises
    ------
    ValueError
        If it is not JSON, or nested deeper than `DEEPEST`.
    """
    too_deep = f"nested deeper than {DEEPEST} times"
    try:
        value = json.loads(text)
    except RecursionError:
        raise ValueError(too_deep) from None
    level = [value]
    for _ in range(DEEPEST):
        level = [inner for outer in level for inner in _within(outer)]
        if not level:
            return value
    raise ValueError(too_deep)


def _within(value: Any) -> list[Any]:
    return list(value.values()) if isinstance(value, dict) else value if isinstance(value, list) else []
