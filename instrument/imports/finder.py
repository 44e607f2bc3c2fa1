"""Finds the pictures that a `capture.toml` names, and keeps what was wrong with the names."""

from __future__ import annotations

import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

from instrument.config.capture_config import BesideTable
from instrument.config.messages import dotted
from instrument.config.toml_lines import KeyPath
from instrument.pictures.reading import is_picture

Complaint = tuple[KeyPath, str]


@dataclass(frozen=True, slots=True)
class Pick:
    """A picture that is asked for.

    Attributes
    ----------
    path : Path
    name : str
        Its path within the folder, with slashes.
    key : tuple
        Which key of the `capture.toml` asks for it.
    stated_time : float or None
        Exposure time in seconds, if that is stated there.
    """

    path: Path
    name: str
    key: KeyPath
    stated_time: float | None = None


class Finder:
    """Finds pictures in a folder and keeps what was wrong."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.complaints: list[Complaint] = []

    def complain(self, key: KeyPath, what: str) -> None:
        """Keep a complaint about `key`."""
        self.complaints.append((key, f"{dotted(key)}: {what}"))

    def table(self, table: BesideTable | None, key: str) -> tuple[Pick, ...]:
        """Return the pictures of a table that has `files` and `exposure_times_s`."""
        if table is None:
            return ()
        return self.find(table.files, table.exposure_times_s, (key, "files"))

    def find(self, files: Sequence[str], times: Sequence[float] | None, key: KeyPath) -> tuple[Pick, ...]:
        """Return the pictures that `files` name, with their `times` if these are stated."""
        found = [(path, (*key, i)) for i, name in enumerate(files) for path in self._expanded(name, (*key, i))]
        if times is not None and len(times) not in (1, len(found)):
            self.complain(key, f"there are {len(found)} pictures and {len(times)} exposure times; give one for each")
            times = None
        each = [None] * len(found) if times is None else list(times) * (len(found) if len(times) == 1 else 1)
        return tuple(Pick(path, self.name(path), where, time) for (path, where), time in zip(found, each, strict=True))

    def fitting(self, pattern: str, key: KeyPath) -> list[Path]:
        """Return the pictures that fit `pattern`, in the order of their names."""
        try:
            found = [path for path in self.folder.glob(_any_case(pattern)) if path.is_file() and is_picture(path)]
        except (NotImplementedError, ValueError) as error:  # what pathlib raises for patterns like /x and **x
            self.complain(key, f"{pattern!r} cannot be used: {error}")
            return []
        return sorted(found, key=lambda path: natural_order(self.name(path)))

    def name(self, path: Path) -> str:
        """Return the path of a picture within the folder."""
        return path.relative_to(self.folder).as_posix()

    def _expanded(self, name: str, key: KeyPath) -> list[Path]:
        if Path(name).is_absolute():
            self.complain(key, f"{name!r} is no name within {self.folder}")
            return []
        if (self.folder / name).is_file():
            return [self.folder / name]
        found = self.fitting(name, key) if re.search(r"[*?\[]", name) else self._written_otherwise(name)
        if not found:
            self.complain(key, f"{name!r} is not in {self.folder}{self._hint(name)}")
        return found

    def _written_otherwise(self, name: str) -> list[Path]:
        """Return the picture of a name whose letters are composed otherwise, as a Mac decomposes its umlauts."""
        wanted = unicodedata.normalize("NFC", name)
        found = (path for path in self.folder.rglob("*") if path.is_file() and not path.name.startswith("."))
        return [path for path in found if unicodedata.normalize("NFC", self.name(path)) == wanted][:1]

    def _hint(self, name: str) -> str:
        close = get_close_matches(name, [self.name(path) for path in self.folder.rglob("*") if path.is_file()], n=1)
        return f"; did you mean {close[0]!r}?" if close else ""


def _any_case(pattern: str) -> str:
    """Return a pattern that finds `.DNG` where `.dng` is asked for: cameras and copies of one card differ in that."""
    parts = re.split(r"(\[[^\]]*\])", pattern)
    return "".join(
        part if part.startswith("[") else "".join(f"[{c.lower()}{c.upper()}]" if _has_case(c) else c for c in part)
        for part in parts
    )


def _has_case(letter: str) -> bool:
    return letter.lower() != letter.upper() and len(letter.lower()) == len(letter.upper()) == 1


def natural_order(name: str) -> list[tuple[int, str]]:
    """Sort key that puts ``IMG_9`` before ``IMG_10``."""
    return [(int(part), "") if part.isdecimal() else (-1, part.lower()) for part in re.split(r"(\d+)", name)]
