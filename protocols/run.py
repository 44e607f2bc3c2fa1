"""Runs a plan on a rig pose by pose; whatever happens, the light goes off first and the file stays good."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np

from drivers.errors import DeviceError
from instrument.layout import Status
from instrument.recorder import Recorder
from instrument.rig import Rig
from protocols.bracket import take_darks, take_pose
from protocols.plan import Plan
from protocols.progress import Progress, State, Watcher, tell

ATTEMPTS = 3

Taken = TypeVar("Taken")


class CaptureFaultError(DeviceError):
    """A capture stopped because of a device; its session can be resumed."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How a capture ended.

    Attributes
    ----------
    state : State
        `State.SAFE` when every pose is taken, `State.PAUSED` when somebody interrupted it.
    path : Path
        The session.
    n_complete, n_poses : int
        Poses in the session, and all of them.
    message : str
        In words, with what to do next.
    """

    state: State
    path: Path
    n_complete: int
    n_poses: int
    message: str


class Run:
    """One run over the poses that are still missing.

    The pose is the only atom: it is taken and written whole, or taken again. A run after a crash is
    no different from the first one: it goes on at the first pose that is not complete.

    Parameters
    ----------
    rig : Rig
        Connected.
    recorder : Recorder
        Of the session at `path`.
    plan : Plan
        As frozen in the session.
    path : Path
        For messages.
    complete : collection of int
        Poses that the session holds already.
    has_darks : bool
        Whether the session holds its darks already.
    watcher : callable, optional
        Told about every step.
    """

    def __init__(
        self,
        rig: Rig,
        recorder: Recorder,
        plan: Plan,
        path: Path,
        complete: Collection[int] = (),
        has_darks: bool = False,
        watcher: Watcher | None = None,
    ) -> None:
        self.state = State.IDLE
        self._rig, self._recorder, self._plan, self._path = rig, recorder, plan, path
        self._missing = [i_pose for i_pose in range(plan.n_poses) if i_pose not in complete]
        self._n_taken = 0
        self._n_frames = 0
        self._needs_darks = plan.darks > 0 and not has_darks
        self._unsafe: tuple[str, ...] = ()
        self._unclosed = ""
        self._watcher = watcher
        self._began = self._poses_began = time.monotonic()

    def run(self) -> Outcome:
        """Home, take the darks and every missing pose.

        Returns
        -------
        Outcome
            Complete, or paused by Ctrl-C.

        Raises
        ------
        CaptureFaultError
            If a device kept failing; says how to go on.
        OSError
            If the session cannot be written.
        """
        try:
            self._capture()
            return self._finish()
        except KeyboardInterrupt:
            self._leave(State.PAUSED, "interrupted")
            if self._unsafe:
                raise CaptureFaultError(f"interrupted. {self._how_to_go_on}") from None
            return self._outcome(f"interrupted. {self._how_to_go_on}")
        except DeviceError as error:
            self._leave(State.FAULT, str(error))
            raise CaptureFaultError(f"{error}. {self._how_to_go_on}") from error
        except OSError as error:
            self._leave(State.FAULT, str(error))
            raise OSError(error.errno, f"{error.strerror or error}. {self._how_to_go_on}") from error
        except BaseException as error:
            self._leave(State.FAULT, str(error))
            error.add_note(self._how_to_go_on)
            raise

    def _capture(self) -> None:
        self._report(State.RUNNING, "homing the stage")
        self._rig.stage.home()
        if self._needs_darks:
            self._report(State.RUNNING, "taking darks")
            self._darks()
        self._poses_began = time.monotonic()
        for i_pose in self._missing:
            self._report(State.RUNNING, f"pose {i_pose + 1} of {self._plan.n_poses}")
            self._pose(i_pose)

    def _darks(self) -> None:
        times, count = self._plan.exposure_times, self._plan.darks
        darks = self._repeated("the darks", lambda _: [take_darks(self._rig, t, count) for t in times])
        means, variances, when = zip(*darks, strict=True)
        self._recorder.write_darks(np.stack(means), np.stack(variances), list(when))
        self._n_frames += self._plan.n_darks

    def _pose(self, i_pose: int) -> None:
        target, times = self._plan.target(i_pose), self._plan.exposure_times
        record = self._repeated(f"pose {i_pose}", lambda n: take_pose(self._rig, target, times, n))
        self._recorder.write_pose(i_pose, record)
        self._n_taken += 1
        self._n_frames += len(times)

    def _repeated(self, what: str, take: Callable[[int], Taken]) -> Taken:
        """Return what `take` takes; it is told the number of its attempt, from 1."""
        for attempt in range(1, ATTEMPTS):
            try:
                return take(attempt)
            except DeviceError as error:
                self._rig.safe()
                self._recorder.note("repeated", what=what, attempt=attempt, why=str(error))
                self._report(State.RUNNING, f"{what} failed and is repeated: {error}")
        return take(ATTEMPTS)

    def _finish(self) -> Outcome:
        self._report(State.FINISHING, "closing the session")
        failures = self._rig.safe()
        if failures:
            raise DeviceError("; ".join(failures))
        self._recorder.close(Status.COMPLETE)
        self._report(State.SAFE, "complete")
        return self._outcome("complete")

    def _leave(self, state: State, why: str) -> None:
        """Make the rig safe, and then the file; what fails on the way is kept for the message."""
        self._unsafe = self._rig.safe()
        try:
            self._recorder.note(state.name.lower(), why=why)
            self._recorder.close(Status.INTERRUPTED)
        except Exception as failure:
            self._unclosed = f" The session could not be closed: {failure}."
        self._report(state, why)

    @property
    def _n_complete(self) -> int:
        return self._plan.n_poses - len(self._missing) + self._n_taken

    @property
    def _how_to_go_on(self) -> str:
        rig = f"NOT SAFE: {'; '.join(self._unsafe)}" if self._unsafe else "The light is off"
        return (
            f"{rig}; {self._n_complete} of {self._plan.n_poses} poses are safe in {self._path}."
            f"{self._unclosed} "
            f"Go on with: halfangle resume {self._path}"
        )

    def _outcome(self, message: str) -> Outcome:
        return Outcome(self.state, self._path, self._n_complete, self._plan.n_poses, message)

    def _report(self, state: State, message: str) -> None:
        self.state = state
        now = time.monotonic()
        left = len(self._missing) - self._n_taken
        remaining = (now - self._poses_began) / self._n_taken * left if self._n_taken else math.nan
        progress = Progress(
            state,
            self._n_complete,
            self._plan.n_poses,
            self._n_frames,
            now - self._began,
            remaining,
            message,
        )
        tell(self._watcher, progress)
