"""Runs a plan on a rig pose by pose; whatever happens, the light goes off first and the file stays good."""

from __future__ import annotations

import logging
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from drivers.errors import CancelledError, DeviceError, DeviceLostError, DeviceTimeoutError
from instrument.recording.recorder import Recorder
from instrument.rig.bounded import within
from instrument.rig.rig import Rig
from instrument.session.audit import AuditLog
from instrument.session.layout import Status
from instrument.session.preview import Preview
from instrument.session.records import PoseRecord
from protocols.acquisition.bracket import Bracket, take_pose
from protocols.acquisition.darks_and_flats import take_darks, take_flats
from protocols.acquisition.frame_checks import CLIPPED_SHARE, clipped_shares
from protocols.acquisition.reference_patch import ReferencePatch
from protocols.acquisition.sample_position import Landmark, check_not_moved, light_changed
from protocols.acquisition.shot import move_verified
from protocols.acquisition.warm_up import warm_up
from protocols.capture.control import Control
from protocols.capture.pose_writer import PoseWriter
from protocols.capture.progress import Finish, News, Outcome, PoseBegun, Progress, State, Watcher, tell
from protocols.capture.recovery import Recovery
from protocols.capture.thumbnails import pose_taken
from protocols.planning.plan import Plan
from protocols.planning.planned_poses import PlannedPoses

_log = logging.getLogger(__name__)

CLOSE_LIMIT = 60.0
"""Seconds that closing the session may take; a stalled disk must not keep anybody waiting for ever."""

MAX_DEAFNESS = 1.0
"""Seconds on the rig's clock that a wait for the next pose may keep somebody waiting who asks for a pause."""


class CaptureFaultError(DeviceError):
    """A capture stopped because of a device; its session can be resumed."""


class PausedError(Exception):
    """The run is to stop between two poses; the message says why."""


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
    monitor: float = math.nan
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
        self._unsafe: tuple[str, ...] = ()
        self._unclosed = ""
        self._began = self._poses_began = rig.clock.now()
        # Whoever watches has to know; at the end it is of no weight, since nothing was lost by it.
        self._recovery = Recovery(rig, audit.note, lambda what: self._report(self.state, what, what))
        self._patch = ReferencePatch(rig.config, rig.camera.describe(), rig.stage.describe())
        self._writer = PoseWriter(recorder, audit)

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
        self._watch_light(i_pose, record)
        self._watch_sensor(record)
        self._watch_clipping(i_pose, record)

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

    def _watch_light(self, i_pose: int, record: PoseRecord) -> None:
        monitor = float(record.monitor.mean())
        if math.isnan(self._tally.monitor):
            self._tally.monitor = monitor
        change = monitor / self._tally.monitor - 1.0 if self._tally.monitor else math.nan
        if abs(change) > self._rig.config.light.drift_band:
            self._audit.note("drift", pose=i_pose, monitor=monitor, change=change)
            self._warn(f"the light's monitor changed by {change:+.1%} since the first pose (pose {i_pose})")

    def _watch_sensor(self, record: PoseRecord) -> None:
        warmer = float(record.sensor_temperature.mean()) - self._begun.dark_temperature
        if self._tally.n_taken == 1 and abs(warmer) > self._begun.temperature_band:
            self._audit.note("temperature", warmer=warmer)
            self._warn(
                f"the sensor is {abs(warmer):.1f} degrees {'warmer' if warmer > 0 else 'colder'} than at the darks "
                f"(allowed {self._begun.temperature_band:g}). Take new darks"
            )

    def _watch_clipping(self, i_pose: int, record: PoseRecord) -> None:
        share = float(clipped_shares(record.counts[:1], self._rig.camera.describe())[0])
        if share <= CLIPPED_SHARE:
            return
        what = f"pose {i_pose}: {share:.1%} of the shortest exposure clips"
        self._audit.note("clipped", pose=i_pose, share=share)
        self._warn(f"{what}. Add a shorter exposure, or lower light.level")
        if self._plan.when_clipped == "pause":
            raise PausedError(f"{what}, and the protocol says to pause there")

    def _finish(self) -> Outcome:
        self._report(State.FINISHING, "closing the session")
        failures = self._rig.safe()
        if failures:
            raise DeviceError("; ".join(failures))
        self._writer.finish()
        self._close(Finish.COMPLETE, Status.COMPLETE, "")
        self._report(State.SAFE, "complete")
        return self._outcome(Finish.COMPLETE, "complete")

    def _end(self, error: BaseException) -> Outcome:
        """Make the rig safe, and then the file; return how the run ended, or raise if that is an error."""
        finish = _finish_of(error)
        self._unsafe = self._rig.safe()
        self._leave(finish, error)
        if self._unsafe or finish is Finish.FAULT:
            fault = self._fault(error)
            raise fault from (None if fault is error else error)
        state = State.PAUSED if finish is Finish.PAUSED else State.SAFE
        self._report(state, str(error))
        return self._outcome(finish, f"{_sentence(str(error) or finish.value)} {self._how_to_go_on}")

    def _leave(self, finish: Finish, error: BaseException) -> None:
        """Write what waits, and close; what fails on the way is kept for the message."""
        try:
            self._writer.finish()
        except BaseException as failure:
            if failure is not error:
                self._unclosed = f" Not all poses could be written: {failure}."
        try:
            self._close(finish, Status.ABORTED if finish is Finish.ABORTED else Status.INTERRUPTED, str(error))
        except Exception as failure:
            # Whoever closes it later must not wait for that disk, too.
            self._recorder.abandon()
            self._unclosed += f" The session could not be closed: {failure}."

    def _close(self, finish: Finish, status: Status, why: str) -> None:
        self._audit.note("finish", finish=finish.value, why=why, unsafe=list(self._unsafe))

        def close() -> None:
            self._recorder.write_events(self._audit.take())
            self._recorder.close(status)

        within(CLOSE_LIMIT, "closing the session", close)

    def _fault(self, error: BaseException) -> BaseException:
        """Return the error to raise, with how to go on."""
        self._report(State.FAULT, str(error))
        if isinstance(error, OSError) and not isinstance(error, DeviceError):
            return OSError(error.errno, f"{_sentence(error.strerror or str(error))} {self._how_to_go_on}")
        if isinstance(error, DeviceError | CancelledError | PausedError | KeyboardInterrupt):
            return CaptureFaultError(f"{_sentence(str(error) or 'interrupted')} {self._how_to_go_on}")
        error.add_note(self._how_to_go_on)
        return error

    @property
    def _n_complete(self) -> int:
        return self._plan.n_poses - len(self._missing) + self._writer.n_written

    @property
    def _how_to_go_on(self) -> str:
        rig = f"NOT SAFE: {'; '.join(self._unsafe)}" if self._unsafe else "The light is off"
        return (
            f"{rig}; {self._n_complete} of {self._plan.n_poses} poses are safe in {self._path}."
            f"{self._unclosed} "
            f"Go on with: halfangle resume {self._path}"
        )

    def _outcome(self, finish: Finish, message: str) -> Outcome:
        seconds = self._rig.clock.now() - self._began
        warnings = tuple(self._tally.warnings)
        return Outcome(finish, self._path, self._n_complete, self._plan.n_poses, message, seconds, warnings)

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
            n_complete=self._n_complete,
            n_poses=self._plan.n_poses,
            n_frames=self._tally.n_frames,
            elapsed=now - self._began,
            remaining=(now - self._poses_began) / n_taken * left if n_taken else math.nan,
            message=message,
            warning=warning,
            news=news,
        )
        tell(self._watcher, progress)


def _finish_of(error: BaseException) -> Finish:
    """Return how a run ends that met `error`: a device that may come back pauses it, all else is a fault."""
    if isinstance(error, CancelledError):
        return Finish.ABORTED
    if isinstance(error, PausedError | KeyboardInterrupt | DeviceLostError | DeviceTimeoutError):
        return Finish.PAUSED
    return Finish.FAULT


def _sentence(text: str) -> str:
    return text if text.endswith((".", "?", "!")) else f"{text}."
