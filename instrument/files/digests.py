"""SHA-256 digests of frames, texts and files."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable
from hashlib import sha256
from pathlib import Path

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


def file_digest(path: Path) -> str:
    """Return the hex SHA-256 of a file's bytes."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
