"""Progress of a capture, for those who watch it, and its outcome."""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from instrument.session.preview import Preview
from protocols.planning.planned_poses import PlannedPoses

_log = logging.getLogger(__name__)


class State(Enum):
    """Where a capture stands; the value is what the operator reads."""

    IDLE = "nothing has begun"
    PREFLIGHT = "checking that the capture can end well"
    WARMUP = "letting the light warm up"
    RUNNING = "capturing"
    PAUSED = "paused between two poses; the light is off"
    FINISHING = "writing the end of the session"
    SAFE = "the light is off, stage and camera are stopped"
    FAULT = "stopped by a fault; the light is off"
    NOT_SAFE = "stopped; the light may shine or the stage may move: look at the rig"


class Finish(Enum):
    """Why a capture ended; the value is what the operator reads."""

    COMPLETE = "complete"
    PAUSED = "paused"
    ABORTED = "aborted"
    FAULT = "fault"


@dataclass(frozen=True, slots=True)
class PoseBegun:
    """A pose that is being taken from now on.

    Attributes
    ----------
    i_pose : int
    """

    i_pose: int


@dataclass(frozen=True, slots=True, eq=False)
class PoseTaken:
    """What was taken at a pose, in small.

    Attributes
    ----------
    i_pose : int
    thumbnails : ndarray of uint8, shape (K, h, w)
        The frames of its bracket, from the black level to the saturation level, at most `thumbnails.MAX_WIDTH` across.
    exposure_times : ndarray, shape (K,)
        Seconds, ascending.
    clipped : ndarray, shape (K,)
        Share of each frame's pixels at the saturation level.
    preview : Preview
        Of the longest exposure that is not clipped.
    """

    i_pose: int
    thumbnails: NDArray[np.uint8]
    exposure_times: NDArray[np.float64]
    clipped: NDArray[np.float64]
    preview: Preview


News = PlannedPoses | PoseBegun | PoseTaken
"""What a report may bring besides words: all poses once, before the first of them; each pose before and after it."""


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
        Seconds of the rig's clock since this run began, and about how many are left by the poses taken so far; NaN
        before the first.
    message : str
        What happens, in words.
    warning : str
        What the operator should know though the capture goes on; empty most of the time.
    news : PlannedPoses, PoseBegun, PoseTaken or None
        What is told of the poses with this report.
    """

    state: State
    n_complete: int
    n_poses: int
    n_frames: int
    elapsed: float
    remaining: float
    message: str
    warning: str = ""
    news: News | None = None

    @classmethod
    def at_start(cls, state: State, n_complete: int, n_poses: int) -> Progress:
        """Return the report before the first frame of a run."""
        return cls(state, n_complete, n_poses, 0, 0.0, math.nan, state.value)


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a capture ended.

    Attributes
    ----------
    finish : Finish
        Why.
    path : Path
        The session.
    n_complete, n_poses : int
        Poses in the session, and all of them.
    message : str
        In words, with what to do next.
    seconds : float
        How long this run took on the rig's clock.
    warnings : tuple of str
        What the operator should know, each once.
    """

    finish: Finish
    path: Path
    n_complete: int
    n_poses: int
    message: str
    seconds: float = 0.0
    warnings: tuple[str, ...] = ()


Watcher = Callable[[Progress], None]


def tell(watcher: Watcher | None, progress: Progress) -> None:
    """Report to `watcher`; its own errors are logged and never stop a capture."""
    if watcher is None:
        return
    try:
        watcher(progress)
    except Exception:
        _log.exception("the progress callback failed; the capture goes on")
