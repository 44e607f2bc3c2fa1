"""Which line of a TOML text a key stands on, so that a message can point there."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator
from typing import Any

from instrument.files.json_text import TOO_DEEP, refuse_deep
from instrument.files.validation import InvalidInputError, Problem

# Characters that are parsed to find out where statements begin: some hundred times those of a real file. A list of
# many lines is parsed again with each of them.
MAX_PARSED = 500_000

KeyPath = tuple[str | int, ...]


def parse_toml(text: str, name: str) -> dict[str, Any]:
    """Return the tables of `text`.

    Raises
    ------
    InvalidInputError
        If `text` is not TOML, with the line in the file `name`.
    """
    try:
        data = tomllib.loads(text)
        refuse_deep(data)
    except ValueError as error:
        line = _error_line(str(error), text)
        what = f"{error}{_decimal_comma(text, line)}"
        raise InvalidInputError(f"{name} is not TOML", [Problem(f"{name}:{line}", what)]) from None
    except RecursionError:
        raise InvalidInputError(f"{name} cannot be used", [Problem(name, f"is {TOO_DEEP}")]) from None
    return data


def _decimal_comma(text: str, line: int) -> str:
    """Return a hint if the line has a number with a comma in it, as in 3,5."""
    lines = text.splitlines()
    is_there = 0 < line <= len(lines) and re.search(r"=\s*[+-]?\d+,\d+\s*(#|$)", lines[line - 1])
    return "; a decimal comma? TOML has the decimal point, as in 3.5" if is_there else ""


class TomlLines:
    """Maps key paths such as ``("boards", 1, "square_mm")`` to line numbers, from 1.

    Parameters
    ----------
    text : str
        A text that `tomllib` has accepted.
    """

    def __init__(self, text: str) -> None:
        self._lines: dict[KeyPath, int] = {}
        self._counts: dict[KeyPath, int] = {}
        self._table: KeyPath = ()
        for line, statement in _statements(text):
            self._place(line, statement)

    def line(self, path: KeyPath) -> int:
        """Return the line of the key at `path`, or of the nearest table around it, or 1."""
        for length in range(len(path), 0, -1):
            if path[:length] in self._lines:
                return self._lines[path[:length]]
        return 1

    def _place(self, line: int, statement: str) -> None:
        content = tomllib.loads(statement)
        if statement.lstrip().startswith("[["):
            self._table = self._new_element(_only_path(content))
            self._lines[self._table] = line
        elif statement.lstrip().startswith("["):
            self._table = self._within_arrays(_only_path(content))
            self._lines[self._table] = line
        else:
            for path in _paths(content):
                self._lines.setdefault(self._table + path, line)

    def _new_element(self, names: KeyPath) -> KeyPath:
        array = (*self._within_arrays(names[:-1]), names[-1])
        index = self._counts.get(array, 0)
        self._counts[array] = index + 1
        return (*array, index)

    def _within_arrays(self, names: KeyPath) -> KeyPath:
        """Insert the index of the last element after the name of each array of tables."""
        path: KeyPath = ()
        for name in names:
            path = (*path, name)
            if path in self._counts:
                path = (*path, self._counts[path] - 1)
        return path


def _statements(text: str) -> Iterator[tuple[int, str]]:
    """Yield each table header or assignment with its first line.

    A part of a statement that ends at a line break leaves a bracket or a string open, so it never
    parses by itself: the first piece that parses is the whole statement.
    """
    piece, first, parsed = "", 1, 0
    for number, line in enumerate(re.split(r"(?<=\n)", text), start=1):
        first = first if piece else number
        piece += line
        parsed += len(piece)
        if parsed > MAX_PARSED:
            # What follows is then said to be where its table is.
            return
        try:
            content = tomllib.loads(piece)
        except tomllib.TOMLDecodeError:
            continue
        if content:
            yield first, piece
        piece = ""


def _paths(content: dict[str, Any]) -> Iterator[KeyPath]:
    for key, value in content.items():
        yield (key,)
        if isinstance(value, dict):
            yield from ((key, *inner) for inner in _paths(value))


def _only_path(content: Any) -> KeyPath:
    """Return the names of a table header, which parses to one chain of dicts and lists."""
    path: KeyPath = ()
    while content:
        if isinstance(content, list):
            content = content[0]
        else:
            ((key, content),) = content.items()
            path = (*path, key)
    return path


def _error_line(message: str, text: str) -> int:
    match = re.search(r"at line (\d+)", message)
    return int(match.group(1)) if match else max(1, len(text.splitlines()))
