"""Captures a protocol into a session, and goes on with a session that was interrupted."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pydantic import ValidationError

from drivers.camera import CameraDescription
from drivers.errors import DeviceError
from drivers.registry import open_devices
from instrument.config import ProtocolConfig, RigConfig
from instrument.layout import Status
from instrument.recorder import Recorder
from instrument.records import CameraRecord, Geometry
from instrument.rig import OpenDevices, Rig
from instrument.session import Session
from instrument.session_file import create_session, refuse_existing
from instrument.session_header import Provenance, SessionHeader
from instrument.validation import InvalidInputError, Problem, raise_if_any
from instrument.verify import plan_problems
from protocols.plan import Plan
from protocols.preflight import preflight_problems
from protocols.progress import Progress, State, Watcher, tell
from protocols.run import CaptureFaultError, Outcome, Run

NOTHING_TO_DO = "already complete; there is nothing to do"

__all__ = ["CaptureFaultError", "Outcome", "Progress", "State", "capture", "resume"]


def capture(
    rig_config: RigConfig,
    protocol_config: ProtocolConfig,
    path: Path | str,
    progress: Watcher | None = None,
    devices: OpenDevices = open_devices,
) -> Outcome:
    """Capture a protocol on a rig into a new session.

    Parameters
    ----------
    rig_config : RigConfig
        As `instrument.config.load_rig` reads it.
    protocol_config : ProtocolConfig
        As `instrument.config.load_protocol` reads it.
    path : Path or str
        The session to write; there must be no such file.
    progress : callable, optional
        Told about every step; its errors are logged and do not stop the capture.
    devices : callable, optional
        Opens the devices of a rig; by default those that the rig names.

    Returns
    -------
    Outcome
        Complete, or paused by Ctrl-C.

    Raises
    ------
    InvalidInputError
        If the rig cannot do the protocol; nothing has moved or lit then, and nothing is written.
    DeviceError
        If a device kept failing; the light is off, and `resume` goes on.
    OSError
        If there is a file at `path`, the disk is too small, or writing fails.
    """
    path, plan = Path(path), Plan.from_protocol(protocol_config)
    refuse_existing(path)
    tell(progress, Progress.at_start(State.PREFLIGHT, 0, plan.n_poses))
    with Rig.connected(rig_config, devices) as rig:
        raise_if_any("the rig cannot do this protocol", preflight_problems(rig, plan))
        header = _header(rig, protocol_config, plan)
        create_session(path, header, plan.bytes(header.camera.height, header.camera.width))
        with Recorder(path) as recorder:
            return Run(rig, recorder, plan, path, watcher=progress).run()


def resume(path: Path | str, progress: Watcher | None = None, devices: OpenDevices = open_devices) -> Outcome:
    """Go on with a session at its first incomplete pose, with the rig and the plan it holds itself.

    Parameters
    ----------
    path : Path or str
        A session, interrupted in any way; one that is complete is left as it is.
    progress, devices : callable, optional
        As for `capture`.

    Raises
    ------
    InvalidInputError
        If the file is no session, or its plan was changed.
    DeviceError
        If a device keeps failing, or is not the one that began the session.
    OSError
        If the session cannot be written, for one because another process writes it.
    """
    imported = _imported(Path(path))
    if imported is not None:
        return imported
    begun = _Begun.read(Path(path))
    n_poses = begun.plan.n_poses
    if len(begun.complete) == n_poses:
        return _close_complete(begun)
    tell(progress, Progress.at_start(State.PREFLIGHT, len(begun.complete), n_poses))
    with Rig.connected(begun.rig, devices) as rig:
        _check_same_devices(rig, begun)
        raise_if_any("the rig cannot go on", preflight_problems(rig, begun.plan))
        with Recorder(begun.path) as recorder:
            recorder.note("resumed", n_complete=len(begun.complete))
            run = Run(rig, recorder, begun.plan, begun.path, begun.complete, begun.has_darks, progress)
            return run.run()


@dataclass(frozen=True, slots=True)
class _Begun:
    """What a session says about how to go on with it."""

    path: Path
    rig: RigConfig
    plan: Plan
    complete: Collection[int]
    has_darks: bool
    status: Status
    serial_numbers: dict[str, str]

    @classmethod
    def read(cls, path: Path) -> _Begun:
        with Session(path) as session:
            raise_if_any(f"{path} cannot be resumed", plan_problems(session))
            return cls(
                path=path,
                rig=_rig_from(session),
                plan=Plan.from_json(session.plan_json),
                complete=frozenset(np.flatnonzero(session.pose_complete).tolist()),
                has_darks=session.has_darks,
                status=session.status,
                serial_numbers=session.serial_numbers,
            )


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
    return Outcome(State.SAFE, path, n_poses, n_poses, NOTHING_TO_DO)


def _rig_from(session: Session) -> RigConfig:
    try:
        rig = RigConfig.model_validate_json(session.rig_json, strict=True)
    except ValidationError as error:
        problem = Problem("/entry/process_capture/rig_values", f"is no rig of this release: {error}")
        raise InvalidInputError(f"{session.path} cannot be resumed", [problem]) from None
    rig.remember(session.rig_text)
    return rig


def _header(rig: Rig, protocol: ProtocolConfig, plan: Plan) -> SessionHeader:
    sample = protocol.sample or "a sample"
    light, stage = rig.light.describe(), rig.stage.describe()
    return SessionHeader(
        title=protocol.name,
        sample=protocol.sample,
        description=f"{protocol.name}: {sample} on {rig.config.name}",
        plan_json=plan.json,
        plan_sha256=plan.sha256,
        n_poses=plan.n_poses,
        exposure_times=plan.exposure_times,
        camera=_camera_record(rig.camera.describe()),
        geometry=_geometry(rig.config),
        boards=tuple(board.record for board in rig.config.boards),
        provenance=Provenance(protocol.text, rig.config.text, rig.config.model_dump_json()),
        light_type="LED",
        light_serial=light.serial_number,
        stage_serial=stage.serial_number,
        axes=stage.axes,
        targets=plan.targets,
        has_darks=plan.darks > 0,
    )


def _camera_record(camera: CameraDescription) -> CameraRecord:
    return CameraRecord(
        make=camera.make,
        model=camera.model,
        serial_number=camera.serial_number,
        height=camera.height,
        width=camera.width,
        n_channels=1,
        dtype="u2",
        bit_depth=camera.bit_depth,
        black_level=camera.black_level,
        saturation_value=camera.saturation_level,
        bayer_pattern=camera.bayer_pattern,
        conversion_gain=camera.conversion_gain,
        read_noise=camera.read_noise,
    )


def _geometry(rig: RigConfig) -> Geometry:
    sigma = rig.light.offset_sigma_mm
    return Geometry(
        area_mm=rig.geometry.area_mm,
        working_distance_mm=rig.geometry.working_distance_mm,
        focal_length_px=rig.camera.focal_length_px,
        light_offset_mm=rig.light.offset_mm,
        light_offset_sigma_mm=(sigma, sigma, sigma),
    )


def _close_complete(begun: _Begun) -> Outcome:
    """Leave a complete session alone; one killed after its last pose gets its last line."""
    if begun.status is not Status.COMPLETE:
        with Recorder(begun.path) as recorder:
            recorder.close(Status.COMPLETE)
    n_poses = begun.plan.n_poses
    return Outcome(State.SAFE, begun.path, n_poses, n_poses, NOTHING_TO_DO)


def _check_same_devices(rig: Rig, begun: _Begun) -> None:
    connected = {
        "camera": rig.camera.describe().serial_number,
        "light": rig.light.describe().serial_number,
        "stage": rig.stage.describe().serial_number,
    }
    swapped = [
        f"the {kind} is {connected[kind]!r} and was {serial!r}"
        for kind, serial in begun.serial_numbers.items()
        if connected[kind] != serial
    ]
    if swapped:
        raise DeviceError(
            f"{'; '.join(swapped)}. A session is finished on the devices that began it: connect those, or capture anew"
        )
