"""What commands share: where files go, what they print."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from instrument.files.validation import InvalidInputError, Problem
from instrument.files.whole_file import refuse_unreadable, written_whole

FINISHED_WITH_WARNINGS = 3
"""Exit code: what was asked for is done, and is not to be trusted before it has been looked at."""


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


def write_json(
    path: Path, value: Any, *, read: Callable[[Path], object] | None = None, overwrite: bool = False
) -> None:
    """Write `value` as JSON, whole or not at all; NaN and infinities become null, since JSON has none.

    Parameters
    ----------
    path : Path
    value : object
    read : callable, optional
        Its reader, which has to take the file.
    overwrite : bool
        Takes the place of a file that is there.

    Raises
    ------
    FileExistsError
        If there is something at `path` and it is not to be overwritten.
    InvalidInputError
        If `read` refuses it.
    NotWrittenError
        If the disk or the folder does not take it.
    """
    text = json.dumps(finite(value), indent=2) + "\n"
    with written_whole(path, overwrite=overwrite, n_bytes=len(text)) as part:
        part.write_text(text, encoding="utf-8")
        if read is not None:
            refuse_unreadable(path, part, read)


def finite(value: Any) -> Any:
    """Return values for JSON with null for NaN and infinities, and plain numbers for numpy's."""
    if isinstance(value, dict):
        return {key: finite(v) for key, v in value.items()}
    if isinstance(value, list | tuple):
        return [finite(v) for v in value]
    if isinstance(value, float | np.floating):
        return float(value) if np.isfinite(value) else None
    return value.item() if isinstance(value, np.generic) else value


def parse_position(text: str, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Parse ``"X,Y,Z"`` in mm of the sample frame.

    Raises
    ------
    InvalidInputError
    """
    try:
        position = np.array([float(part) for part in text.split(",")])
    except ValueError:
        position = np.zeros(0)
    if position.shape != (3,) or not np.all(np.isfinite(position)) or position[2] <= 0:
        what = f"is {text!r}; must be X,Y,Z in mm of the sample frame with Z above the sample, e.g. 0,0,350"
        raise InvalidInputError("The position cannot be used.", [Problem(name, what)])
    return position
