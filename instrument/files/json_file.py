"""Writes JSON files, whole or not at all."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from instrument.files.whole_file import refuse_unreadable, written_whole


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
