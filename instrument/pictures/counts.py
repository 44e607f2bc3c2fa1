"""A frame's raw counts as a picture of 16 bits."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
from numpy.typing import NDArray

from instrument.files.validation import InvalidInputError, Problem
from instrument.files.whole_file import write_whole

SUFFIXES = (".png", ".tif", ".tiff")


def check_counts_name(path: Path) -> None:
    """Refuse a name that is not of a picture of 16 bits; asked before anything shines.

    Raises
    ------
    InvalidInputError
    """
    if path.suffix.lower() not in SUFFIXES:
        what = f"is no picture of 16 bits; use {' or '.join(SUFFIXES)}"
        raise InvalidInputError("The frame cannot be written.", [Problem(str(path), what)])


def write_counts(path: Path, counts: NDArray[Any]) -> None:
    """Write counts, shape (height, width) or (height, width, 3), to a new file.

    Raises
    ------
    FileExistsError
        If there is a file already.
    NotWrittenError
        If the disk or the folder does not take it.
    """
    write_whole(path, cv2.imencode(path.suffix, counts)[1].tobytes())
