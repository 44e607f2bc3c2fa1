"""Runs a plan on a rig pose by pose; whatever happens, the light goes off first and the file stays good."""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from instrument.recording.recorder import Recorder
from instrument.rig.rig import Rig
from instrument.session.audit import AuditLog
from instrument.session.preview import Preview
from instrument.session.records import PoseRecord
from protocols.acquisition.bracket import Bracket, take_pose
from protocols.acquisition.darks_and_flats import take_darks, take_flats
from protocols.acquisition.reference_patch import ReferencePatch
from protocols.acquisition.sample_position import Landmark, check_not_moved, light_changed
from protocols.acquisition.shot import move_verified
from protocols.acquisition.warm_up import warm_up
from protocols.capture.control import Control
from protocols.capture.ending import Ending
from protocols.capture.errors import PausedError
from protocols.capture.pose_writer import PoseWriter
from protocols.capture.progress import Finish, News, Outcome, PoseBegun, Progress, State, Watcher, tell
from protocols.capture.recovery import Recovery
from protocols.capture.thumbnails import pose_taken
from protocols.capture.watching import PoseWatch
from protocols.planning.plan import Plan
from protocols.planning.planned_poses import PlannedPoses

_log = logging.getLogger(__name__)

MAX_DEAFNESS = 1.0
"""Seconds on the rig's clock that a wait for the next pose may keep somebody waiting who asks for a pause."""


@dataclass(frozen=True, slots=True)
class Begun:
    """What a session holds before a run.

    Attributes
    ----------
    complete : collection of int
        Poses that are whole.
    darkness : tuple of float, length E
        Mean counts of its darks; empty where it has none yet.
    dark_temperature : float
        Of the sensor at its darks, degrees Celsius; NaN where not known, or where they are taken in this run.
    temperature_band : float
        How far the sensor may be from it before that is told.
    has_flats : bool
        Whether its flat frames are whole.
    landmark : Landmark or None
        A frame to find out by whether the sample was moved since.
    previews : mapping of int to Preview
        Of its complete poses, to be shown; it may lack some.
    """

    complete: Collection[int] = ()
    darkness: tuple[float, ...] = ()
    dark_temperature: float = math.nan
    temperature_band: float = 5.0
    has_flats: bool = False
    landmark: Landmark | None = None
    previews: Mapping[int, Preview] = field(default_factory=dict)


@dataclass
class _Tally:
    """What a run has done so far."""

    n_taken: int = 0
    n_frames: int = 0
    warnings: dict[str, None] = field(default_factory=dict)


class Run:
    """One run over the poses that are still missing.

    The pose is the only atom: it is taken and written whole, or taken again. A run after a pause or a crash is no
    different from the first one: it goes on at the first pose that is not complete.

    Parameters
    ----------
    rig : Rig
        Connected.
    recorder : Recorder
        Of the session at `path`; closed at the end, however that comes.
    audit : AuditLog
        Of that session.
    plan : Plan
        As frozen in the session.
    path : Path
        For messages.
    begun : Begun, optional
        What the session holds already.
    control : Control, optional
        By which somebody may ask to stop.
    watcher : callable, optional
        Told about every step.
    """

    def __init__(
        self,
        rig: Rig,
        recorder: Recorder,
        audit: AuditLog,
        plan: Plan,
        path: Path,
        begun: Begun | None = None,
        control: Control | None = None,
        watcher: Watcher | None = None,
    ) -> None:
        self.state = State.IDLE
        self._rig, self._recorder, self._audit, self._plan, self._path = rig, recorder, audit, plan, path
        self._begun, self._control, self._watcher = begun or Begun(), control or Control(), watcher
        self._missing = [i_pose for i_pose in range(plan.n_poses) if i_pose not in self._begun.complete]
        self._tally = _Tally()
        self._began = self._poses_began = rig.clock.now()
        # Whoever watches has to know; at the end it is of no weight, since nothing was lost by it.
        self._recovery = Recovery(rig, audit.note, lambda what: self._report(self.state, what, what))
        self._patch = ReferencePatch(rig.config, rig.camera.describe(), rig.stage.describe())
        self._writer = PoseWriter(recorder, audit)
        self._ending = Ending(rig, recorder, audit, self._writer, path, plan.n_poses, plan.n_poses - len(self._missing))
        self._watch = PoseWatch(
            rig,
            audit,
            self._begun.dark_temperature,
            self._begun.temperature_band,
            pauses_when_clipped=plan.when_clipped == "pause",
            warn=self._warn,
        )

    def run(self) -> Outcome:
        """Home, warm up, take the darks, the flats and every missing pose.

        Returns
        -------
        Outcome
            Complete, paused (asked for, or a device that did not come back) or aborted.

        Raises
        ------
        CaptureFaultError
            If a device kept failing or the rig is not safe; says how to go on.
        OSError
            If the session cannot be written.
        """
        try:
            self._capture()
            return self._finish()
        except BaseException as error:
            return self._end(error)

    def _capture(self) -> None:
        self._audit.note("run", plan=self._plan.sha256, missing=len(self._missing), rig=self._rig.config.name)
        planned = PlannedPoses.of(self._rig, self._plan, self._begun.complete, self._begun.previews)
        self._report(State.RUNNING, "homing the stage", news=planned)
        self._recovery.repeated("homing the stage", lambda _: self._rig.stage.home())
        darkness = self._begun.darkness or self._darks()
        if self._rig.config.light.warm_up_s > 0.0:
            self._warm_up()
        if self._begun.landmark is not None:
            self._look_again(self._begun.landmark)
        if self._plan.flats and not self._begun.has_flats:
            self._flats()
        self._poses(Bracket(self._plan.exposure_times, self._plan.n_spare, darkness))

    def _darks(self) -> tuple[float, ...]:
        """Take the darks of the plan and return their mean counts, or what the camera says of darkness."""
        times, count = self._plan.exposure_times, self._plan.darks
        if not count:
            return (self._rig.camera.describe().black_level,) * len(times)
        self._report(State.RUNNING, "taking darks")
        darks = self._recovery.repeated("the darks", lambda _: [take_darks(self._rig, t, count) for t in times])
        means, variances, when, temperatures = zip(*darks, strict=True)
        self._recorder.write_darks(np.stack(means), np.stack(variances), list(when), list(temperatures))
        self._tally.n_frames += self._plan.n_darks
        return tuple(float(mean.mean()) for mean in means)

    def _warm_up(self) -> None:
        self._report(State.WARMUP, "letting the light warm up")
        done = self._recovery.repeated("the warm-up", lambda _: warm_up(self._rig, self._between_poses))
        self._audit.note("warm", seconds=done.seconds, slope_per_minute=done.slope)
        if not done.steady:
            raise PausedError(
                f"after {done.seconds:g} s the light still drifts by {done.slope:.2%} a minute (allowed "
                f"{self._rig.config.light.steady_per_minute:.2%}). Let it warm up, or look what is wrong with it"
            )

    def _look_again(self, landmark: Landmark) -> None:
        self._report(State.RUNNING, "comparing with a pose taken before")
        scale = self._recovery.repeated("the comparison", lambda _: check_not_moved(self._rig, landmark))
        self._audit.note("compared", pose=landmark.i_pose, brightness=scale)
        self._warn(light_changed(scale))

    def _flats(self) -> None:
        self._report(State.RUNNING, "taking flat frames")
        plan = self._plan

        def take(_: int) -> NDArray[np.uint16]:
            move_verified(self._rig.stage, plan.target(0))
            return take_flats(self._rig, plan.flat_time, plan.flats)

        self._recorder.write_flats(self._recovery.repeated("the flats", take), [plan.flat_time] * plan.flats)
        self._tally.n_frames += plan.flats

    def _poses(self, bracket: Bracket) -> None:
        self._poses_began = begins = self._rig.clock.now()
        for i_pose in self._missing:
            self._between_poses()
            self._report(State.RUNNING, self._name(i_pose), news=PoseBegun(i_pose))
            while (left := begins - self._rig.clock.now()) > 0.0:
                self._rig.wait(min(left, MAX_DEAFNESS))
                self._between_poses()
            begins = self._rig.clock.now() + self._plan.interval
            self._pose(i_pose, bracket)
        self._between_poses()

    def _pose(self, i_pose: int, bracket: Bracket) -> None:
        target = self._plan.target(i_pose)

        def take(attempt: int) -> PoseRecord:
            return take_pose(self._rig, target, bracket, attempt, self._patch)

        record = self._recovery.repeated(f"pose {i_pose}", take)
        self._writer.put(i_pose, record, self._wait_for_disk)
        self._tally.n_taken += 1
        self._tally.n_frames += len(record.counts)
        self._show(i_pose, record)
        self._watch.look(i_pose, record)

    def _show(self, i_pose: int, record: PoseRecord) -> None:
        """Let whoever watches see the pose; pictures for nobody are not made, and none of them stops a capture."""
        if self._watcher is None:
            return
        try:
            taken = pose_taken(i_pose, record, self._rig.camera.describe())
        except Exception:
            _log.exception("the small pictures of %s could not be made; the capture goes on", self._name(i_pose))
        else:
            self._report(State.RUNNING, f"took {self._name(i_pose)}", news=taken)

    def _name(self, i_pose: int) -> str:
        return f"pose {i_pose + 1} of {self._plan.n_poses}"

    def _wait_for_disk(self) -> None:
        """Say that the disk is behind; the light is off between poses."""
        self._control.check()
        self._report(State.RUNNING, "waiting for the disk; the light is off")

    def _between_poses(self) -> None:
        self._control.check()
        if self._control.pause_asked:
            raise PausedError("interrupted")

    def _finish(self) -> Outcome:
        self._report(State.FINISHING, "closing the session")
        self._ending.complete()
        self._report(State.SAFE, "complete")
        return self._outcome(Finish.COMPLETE, "complete")

    def _end(self, error: BaseException) -> Outcome:
        """Return how the run ended after `error`, or raise if that is a fault."""
        finish = self._ending.after(error)
        if self._ending.is_unsafe or finish is Finish.FAULT:
            self._report(State.NOT_SAFE if self._ending.is_unsafe else State.FAULT, str(error))
            fault = self._ending.fault(error)
            raise fault from (None if fault is error else error)
        state = State.PAUSED if finish is Finish.PAUSED else State.SAFE
        self._report(state, str(error))
        return self._outcome(finish, self._ending.message(str(error) or finish.value))

    def _outcome(self, finish: Finish, message: str) -> Outcome:
        seconds = self._rig.clock.now() - self._began
        warnings = tuple(self._tally.warnings)
        return Outcome(finish, self._path, self._ending.n_complete, self._plan.n_poses, message, seconds, warnings)

    def _warn(self, warning: str) -> None:
        if warning:
            self._tally.warnings[warning] = None
            self._report(self.state, warning, warning)

    def _report(self, state: State, message: str, warning: str = "", news: News | None = None) -> None:
        self.state = state
        now, n_taken = self._rig.clock.now(), self._tally.n_taken
        left = len(self._missing) - n_taken
        progress = Progress(
            state=state,
            n_complete=self._ending.n_complete,
            n_poses=self._plan.n_poses,
            n_frames=self._tally.n_frames,
            elapsed=now - self._began,
            remaining=(now - self._poses_began) / n_taken * left if n_taken else math.nan,
            message=message,
            warning=warning,
            news=news,
        )
        tell(self._watcher, progress)
