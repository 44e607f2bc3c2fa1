"""The log of a capture: what was commanded, what failed and when the light shone, as JSON lines beside the session.

Every line reaches the operating system at once, so that it outlives the program; the session holds a copy of all of
them, which the recorder takes from here pose by pose.
"""

from __future__ import annotations

import json
import time
from collections.abc import Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from threading import Lock
from typing import Any, TextIO

from instrument.session.layout import MAX_EVENT

# Characters of a text that are kept, shorter and shorter until the line fits.
_LENGTHS = (400, 120, 40, 10)


class AuditLog:
    """Numbered lines, each with a wall time as a label and monotonic seconds to count by.

    Nothing is written before `begin`: a capture that is refused leaves no file.

    Parameters
    ----------
    session : Path
        The session that it is about; the log is the file beside it that `beside` names.
    n_kept : int
        How many lines the session holds already.
    """

    def __init__(self, session: Path, n_kept: int = 0) -> None:
        self.path = beside(session)
        earlier = _lines(self.path)
        # What a kill kept from the session is in the file only.
        self._pending = [line for line in earlier if _number(line) >= n_kept]
        self._next = max([n_kept, *(_number(line) + 1 for line in earlier[-1:])])
        self._waiting: list[str] = []
        self._file: TextIO | None = None
        self._lock = Lock()

    def begin(self) -> None:
        """Open the file and write what was noted so far."""
        with self._lock:
            torn = self.path.exists() and not self.path.read_bytes().endswith(b"\n")
            self._file = self.path.open("a", encoding="utf-8", buffering=1)
            # A kill may have torn the last line: what follows begins on one of its own.
            self._file.write("\n" * torn + "".join(f"{line}\n" for line in self._waiting))

    def note(self, event: str, **details: object) -> None:
        """Append a line."""
        with self._lock:
            line = event_line(event, details, n=self._next, monotonic=round(time.monotonic(), 4))
            self._next += 1
            self._pending.append(line)
            if self._file is None:
                self._waiting.append(line)
                return
            # A full disk must not keep anybody from switching the light off; the session may still take the line.
            with suppress(OSError):
                self._file.write(f"{line}\n")

    def take(self) -> list[str]:
        """Return the lines that the session does not hold yet, and count them as held."""
        with self._lock:
            lines, self._pending = self._pending, []
            return lines

    def close(self) -> None:
        """Close the file; safe to call twice."""
        with self._lock:
            if self._file is not None:
                with suppress(OSError):
                    self._file.close()
                self._file = None


def beside(session: Path) -> Path:
    """Return the path of the log of a session."""
    return session.with_name(f"{session.name}.audit.jsonl")


def _lines(path: Path) -> list[str]:
    if not path.exists():
        return []
    return [line for line in path.read_text(encoding="utf-8", errors="replace").splitlines() if _number(line) >= 0]


def _number(line: str) -> int:
    """Return the number of a line, -1 if it is none of ours or torn."""
    try:
        return int(json.loads(line)["n"])
    except (ValueError, KeyError, TypeError):
        return -1


def event_line(event: str, details: Mapping[str, object], **label: object) -> str:
    """Return an event with its details as a line of JSON, of `MAX_EVENT` bytes at most.

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
        if len(line) <= MAX_EVENT:
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
