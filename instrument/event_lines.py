"""Lines of the journal: one event each, as JSON in ASCII that fits its place in a session."""

from __future__ import annotations

import json
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Any

from instrument.layout import LONGEST_EVENT

# Characters of a text that are kept, shorter and shorter until the line fits.
_LENGTHS = (400, 120, 40, 10)


def event_line(event: str, details: Mapping[str, object], **label: object) -> str:
    """Return an event with its details as a line of JSON, of `LONGEST_EVENT` bytes at most.

    Parameters
    ----------
    event : str
        What happened, in a word or two.
    details : mapping of str to object
        Long texts are cut; what is no JSON becomes a text.
    **label : object
        Further keys, which stand first; the wall time always does.
    """
    for length in _LENGTHS:
        shortened = {key: _shortened(value, length) for key, value in details.items()}
        line = json.dumps({**label, "time": datetime.now(UTC).isoformat(), "event": event, **shortened}, default=str)
        if len(line) <= LONGEST_EVENT:
            return line
    return json.dumps({**label, "time": datetime.now(UTC).isoformat(), "event": event[:100], "details": "too long"})


def _shortened(value: Any, length: int) -> Any:
    if isinstance(value, str):
        return value if len(value) <= length else f"{value[:length]}..."
    if isinstance(value, Mapping):
        return {key: _shortened(part, length) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [_shortened(part, length) for part in value[: max(1, length // 20)]]
    return value
