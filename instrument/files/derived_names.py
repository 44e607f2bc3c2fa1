"""Names of the files that are made of a session and lie next to it: `relief.h5` has `relief.stack.h5` and so on."""

from __future__ import annotations

import re
from pathlib import Path

STACK, RESULT = ".stack.h5", ".result.h5"

CALIBRATION, CALIBRATION_PAGE, REPORT = ".calibration.json", ".calibration.html", ".html"


def name_of(path: Path) -> str:
    """Return what the names of a session's files begin with, given any of them."""
    for ending in (STACK, RESULT, CALIBRATION, CALIBRATION_PAGE, ".h5"):
        if path.name.endswith(ending):
            return path.name.removesuffix(ending)
    return path.stem


def free(path: Path, *endings: str) -> tuple[Path, ...]:
    """Return new files beside a session, one for each ending, all of one number: `relief-2.stack.h5` after the first.

    Nothing that is there is ever written over.
    """
    name, number = name_of(path), 1
    while True:
        numbered = name if number == 1 else f"{name}-{number}"
        files = tuple(path.with_name(numbered + ending) for ending in endings)
        if not any(file.exists() for file in files):
            return files
        number += 1


def made(path: Path, ending: str) -> list[Path]:
    """Return the files of that ending beside a session, the newest first."""
    pattern = re.compile(rf"{re.escape(name_of(path))}(-\d+)?{re.escape(ending)}")
    found = [file for file in path.parent.iterdir() if pattern.fullmatch(file.name) and file.is_file()]
    return sorted(found, key=lambda file: file.stat().st_mtime_ns, reverse=True)
