"""Captures a protocol into a session, and resumes a session that was interrupted."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path

from drivers.errors import CancelledError
from drivers.registry import open_devices
from instrument.config.protocol import ProtocolConfig
from instrument.config.rig import RigConfig
from instrument.files.validation import InvalidInputError, Problem, raise_if_any
from instrument.recording.creation import create_session, refuse_existing
from instrument.recording.recorder import Recorder
from instrument.rig.rig import OpenDevices, Rig
from instrument.session.audit import AuditLog
from instrument.session.layout import Status
from instrument.session.session import Session
from instrument.session_tools.verify import plan_problems
from protocols.capture.control import Control, obeying_signals
from protocols.capture.errors import CaptureFaultError
from protocols.capture.progress import Finish, Outcome, Progress, State, Watcher, tell
from protocols.capture.resumed_session import BegunSession
from protocols.capture.run import Begun, Run
from protocols.capture.session_header import session_header
from protocols.planning.metering import Metered
from protocols.planning.prepare import Prepared, preflight_problems, prepare

NOTHING_TO_DO = "already complete; there is nothing to do"

__all__ = ["CaptureFaultError", "Control", "Finish", "Outcome", "Progress", "State", "capture", "resume"]


def capture(
    rig_config: RigConfig,
    protocol_config: ProtocolConfig,
    path: Path | str,
    progress: Watcher | None = None,
    devices: OpenDevices = open_devices,
    control: Control | None = None,
) -> Outcome:
    """Capture a protocol on a rig into a new session.

    Parameters
    ----------
    rig_config : RigConfig
        As `instrument.config.loading.load_rig` reads it.
    protocol_config : ProtocolConfig
        As `instrument.config.loading.load_protocol` reads it.
    path : Path or str
        The session to write; there must be no such file.
    progress : callable, optional
        Told about every step; its errors are logged and do not stop the capture.
    devices : callable, optional
        Opens the devices of a rig; by default those that the rig names.
    control : Control, optional
        By which another thread may ask to stop. In the main thread, Ctrl-C asks too.

    Returns
    -------
    Outcome
        Complete, paused or aborted.

    Raises
    ------
    InvalidInputError
        If the rig cannot do the protocol; nothing has moved or lit then, and nothing is written.
    DeviceError
        If a device kept failing; the light is off, and `resume` goes on.
    OSError
        If there is a file at `path`, the disk is too small, or writing fails.
    CancelledError
        If somebody asked to stop before anything began.
    """
    path, control = Path(path), control or Control()
    refuse_existing(path)
    tell(progress, Progress.at_start(State.PREFLIGHT, 0, 0))
    with (
        obeying_signals(control),
        closing(AuditLog(path)) as audit,
        Rig.connected(rig_config, devices, control.cancel, audit.note) as rig,
    ):
        prepared, metered = prepare(rig, protocol_config, path).metered(rig)
        _stop_if_asked(control)
        _create(rig, prepared, path)
        audit.begin()
        _note_begin(audit, rig, prepared, metered)
        with Recorder(path) as recorder:
            run = Run(rig, recorder, audit, prepared.plan, path, _known(prepared), control, progress)
            return _with_warnings(run.run(), prepared.warnings)


def resume(
    path: Path | str,
    progress: Watcher | None = None,
    devices: OpenDevices = open_devices,
    control: Control | None = None,
    accept_moved: bool = False,
) -> Outcome:
    """Go on with a session at its first incomplete pose, with the rig and the plan it holds itself.

    Parameters
    ----------
    path : Path or str
        A session, interrupted in any way; one that is complete is left as it is.
    progress, devices, control : optional
        As for `capture`.
    accept_moved : bool
        Go on without looking whether the sample lies where it lay.

    Raises
    ------
    InvalidInputError
        If the file is no session, or its plan was changed.
    DeviceError
        If a device keeps failing, is not the one that began the session, or the sample was moved.
    OSError
        If the session cannot be written, for one because another process writes it.
    """
    imported = _imported(Path(path))
    if imported is not None:
        return imported
    session, control = BegunSession.read(Path(path)), control or Control()
    if session.is_whole:
        return _close_complete(session)
    tell(progress, Progress.at_start(State.PREFLIGHT, len(session.begun.complete), session.plan.n_poses))
    with (
        obeying_signals(control),
        closing(AuditLog(session.path, session.n_events)) as audit,
        Rig.connected(session.rig, devices, control.cancel, audit.note) as rig,
    ):
        rig.check_serial_numbers(session.serial_numbers)
        raise_if_any("the rig cannot go on", preflight_problems(rig, session.plan))
        _stop_if_asked(control)
        begun = replace(session.begun, landmark=None) if accept_moved else session.begun
        with Recorder(session.path) as recorder:
            audit.begin()
            audit.note("resumed", n_complete=len(begun.complete), accept_moved=accept_moved, settings=rig.settings)
            return Run(rig, recorder, audit, session.plan, session.path, begun, control, progress).run()


def _stop_if_asked(control: Control) -> None:
    """Raise `CancelledError` if somebody asked to stop before anything began."""
    if control.pause_asked or control.cancel.is_set():
        raise CancelledError("interrupted before the first motion; nothing was written")


def _create(rig: Rig, prepared: Prepared, path: Path) -> None:
    plan, kept = prepared.plan, prepared.kept
    values = {} if kept is None else kept.for_times(plan.exposure_times)
    sources = {} if kept is None else {"darks and flats": kept.digest}
    header = session_header(rig, prepared.protocol, plan, values, sources)
    create_session(path, header, plan.bytes(header.camera.height, header.camera.width))


def _note_begin(audit: AuditLog, rig: Rig, prepared: Prepared, metered: Metered | None) -> None:
    audit.note(
        "begun",
        serial_numbers=rig.serial_numbers,
        settings=rig.settings,
        plan=prepared.plan.sha256,
        warnings=prepared.warnings,
    )
    if metered is not None:
        audit.note(
            "metered",
            exposure_times_s=metered.exposure_times,
            darkest=metered.scene.darkest,
            brightest=metered.scene.brightest,
            noise=metered.noise,
        )


def _known(prepared: Prepared) -> Begun:
    """Return what a new session holds before its first pose: the darks of an earlier one."""
    kept, config = prepared.kept, prepared.protocol.darks_and_flats
    if kept is None or config is None:
        return Begun()
    return Begun(
        darkness=kept.darkness(prepared.plan.exposure_times),
        dark_temperature=kept.temperature,
        temperature_band=config.largest_temperature_difference,
    )


def _with_warnings(outcome: Outcome, warnings: tuple[str, ...]) -> Outcome:
    return replace(outcome, warnings=(*warnings, *outcome.warnings))


def _imported(path: Path) -> Outcome | None:
    """Return how it stands with a session that was imported, whole or not at all; None for a captured one."""
    with Session(path) as session:
        if not session.is_imported:
            return None
        raise_if_any(f"{path} cannot be resumed", plan_problems(session))
        n_complete, n_poses = int(session.pose_complete.sum()), session.n_poses
    if n_complete < n_poses:
        what = f"holds {n_complete} of {n_poses} poses; import the pictures again: halfangle import FOLDER"
        raise InvalidInputError(f"{path} cannot be resumed", [Problem("/entry/journal/pose_complete", what)])
    return Outcome(Finish.COMPLETE, path, n_poses, n_poses, NOTHING_TO_DO)


def _close_complete(session: BegunSession) -> Outcome:
    """Leave a complete session alone; one killed after its last pose gets its last line."""
    if session.status is not Status.COMPLETE:
        audit = AuditLog(session.path, session.n_events)
        with Recorder(session.path) as recorder:
            recorder.write_events(audit.take())
            recorder.close(Status.COMPLETE)
    n_poses = session.plan.n_poses
    return Outcome(Finish.COMPLETE, session.path, n_poses, n_poses, NOTHING_TO_DO)
