"""Small grey pictures of sessions for lists, from the previews that they hold."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instrument.files.child import ReaderEndedError, in_child
from instrument.files.validation import InvalidInputError
from instrument.session.session import Session

WIDTH = 96
"""Pixels across at most."""

_WHITE, _GAMMA = 99.0, 0.45  # percentile that is shown white; as displays have it


def thumbnails_of(paths: list[Path]) -> dict[Path, NDArray[np.uint8]]:
    """Return a picture of shape (h, w) for each session that has one; of files that cannot be read there is none.

    They are read in a child process, and in another one after each file that ended it.
    """
    pictures: dict[Path, NDArray[np.uint8]] = {}
    left = list(paths)
    while left:
        try:
            for step in in_child("thumbnails", *left):
                left = left[step["n_done"] :] if "n_done" in step else left
                if "pixels" in step:
                    grey = np.frombuffer(base64.b64decode(step["pixels"]), np.uint8)
                    pictures[Path(step["path"])] = grey.reshape(step["shape"])
            return pictures
        except ReaderEndedError:
            left = left[1:]
    return pictures


def thumbnails(*paths: str) -> Iterator[dict[str, Any]]:
    """Yield the picture of each session, and that it is done; runs in the child."""
    for path in paths:
        with suppress(InvalidInputError, OSError), Session(path) as session:
            captured = np.flatnonzero(session.pose_complete)
            if len(captured):
                grey = thumbnail(session.preview(int(captured[0])))
                pixels = base64.b64encode(grey.tobytes()).decode("ascii")
                yield {"path": path, "shape": grey.shape, "pixels": pixels}
        yield {"n_done": 1}


def thumbnail(preview: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return a preview, shape (h, w), as a grey picture of at most `WIDTH` across."""
    step = -(-max(preview.shape) // WIDTH)
    small = np.nan_to_num(preview[::step, ::step], posinf=0.0, neginf=0.0)
    white = max(float(np.percentile(small, _WHITE)), 1e-30)
    return np.asarray(255.0 * np.clip(small / white, 0.0, 1.0) ** _GAMMA, np.uint8)
