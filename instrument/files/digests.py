"""Digests that tell whether a frame is still what the camera gave."""

from __future__ import annotations

from collections.abc import Iterable
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray


def frame_digest(counts: NDArray[np.uint16] | NDArray[np.float32]) -> str:
    """Return the hex SHA-256 of a frame's values, little-endian, in reading order."""
    return sha256(np.ascontiguousarray(counts, counts.dtype.newbyteorder("<")).data).hexdigest()


def chain_digest(digests: Iterable[str]) -> str:
    """Return the hex SHA-256 over other digests in their order."""
    return sha256("".join(digests).encode()).hexdigest()


def text_digest(text: str) -> str:
    """Return the hex SHA-256 of a text in UTF-8."""
    return sha256(text.encode()).hexdigest()
