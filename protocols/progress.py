"""What a running capture tells whoever watches it."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

_log = logging.getLogger(__name__)


class State(Enum):
    """Where a capture stands; the value is what the operator reads."""

    IDLE = "nothing has begun"
    PREFLIGHT = "checking that the capture can end well"
    RUNNING = "capturing"
    PAUSED = "paused between two poses; the light is off"
    FINISHING = "writing the end of the session"
    SAFE = "the light is off, stage and camera are stopped"
    FAULT = "stopped by a fault; the light is off"


@dataclass(frozen=True, slots=True)
class Progress:
    """One report.

    Attributes
    ----------
    state : State
        Where the capture stands.
    n_complete, n_poses : int
        Poses that are safely on the disk, and all of them.
    n_frames : int
        Frames taken in this run, darks included.
    elapsed, remaining : float
        Seconds since this run began, and about how many are left by the poses taken so far; NaN
        before the first.
    message : str
        What happens, in words.
    """

    state: State
    n_complete: int
    n_poses: int
    n_frames: int
    elapsed: float
    remaining: float
    message: str

    @classmethod
    def at_start(cls, state: State, n_complete: int, n_poses: int) -> Progress:
        """Return the report before the first frame of a run."""
        return cls(state, n_complete, n_poses, 0, 0.0, math.nan, state.value)


Watcher = Callable[[Progress], None]


def tell(watcher: Watcher | None, progress: Progress) -> None:
    """Report to `watcher`; its own errors are logged and never stop a capture."""
    if watcher is None:
        return
    try:
        watcher(progress)
    except Exception:
        _log.exception("the progress callback failed; the capture goes on")
