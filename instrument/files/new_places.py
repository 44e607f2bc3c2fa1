"""Where files may be written."""

from __future__ import annotations

from pathlib import Path

from instrument.files.validation import InvalidInputError, Problem


def check_new(*paths: Path) -> None:
    """Refuse to write where there is a file already, or where there is no folder, all at once.

    Raises
    ------
    InvalidInputError
    """
    problems = [
        Problem(str(path), "exists and is not overwritten; choose another name") for path in paths if path.exists()
    ]
    problems += [
        Problem(str(path.parent), f"is no folder; make it first, to write {path.name} there")
        for path in paths
        if not path.parent.is_dir()
    ]
    if problems:
        raise InvalidInputError("Nothing was written.", problems)
