"""The colour filter array: which place of its cell has which channel."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray


def channel_of_cell(bayer_pattern: str) -> NDArray[np.int64]:
    """Return the channel (R 0, G 1, B 2) of each place of the 2 x 2 cell; all 0 for a monochrome sensor."""
    if not bayer_pattern:
        return np.zeros((2, 2), np.int64)
    return np.array(["RGB".index(letter) for letter in bayer_pattern.upper()]).reshape(2, 2)


def cell_shape(counts: NDArray[Any]) -> tuple[int, ...]:
    """Return the shape of what is known per place: (2, 2) of a mosaic's cell, (3,) of channels."""
    return (2, 2) if counts.ndim == 3 else counts.shape[-1:]
