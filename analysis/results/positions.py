"""Positions of camera and light as they are typed."""

from __future__ import annotations

from typing import Any

import numpy as np

from instrument.files.validation import InvalidInputError, Problem


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
