"""Captures on a simulated rig that goes wrong by a script, and what to hold against their outcome."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.errors import DeviceError
from drivers.registry import Devices
from drivers.simulated.clock import VirtualClock
from drivers.simulated.devices import open_faulty
from drivers.simulated.faults import Fault
from drivers.simulated.world import World
from instrument.config.messages import validate
from instrument.config.protocol import ProtocolConfig
from instrument.config.rig import RigConfig
from instrument.recording.recorder import Recorder
from instrument.rig.rig import Rig
from instrument.session.layout import Field
from instrument.session.records import PoseRecord
from instrument.session.session import Session
from protocols.capture.engine import CaptureFaultError, Finish, Outcome, capture, resume
from protocols.capture.progress import Watcher
from tests.campaigns import small_rig
from tests.verifying import verify_session

PROTOCOL = {
    "name": "three views",
    "bracket": {"exposure_times_s": [0.002, 0.01, 0.05], "darks": 2},
    "rings": [{"tilt_deg": 25.0, "count": 3, "start_deg": 10.0}],
}


def rig_config(**light: Any) -> RigConfig:
    """A small rig whose light is warm from the start."""
    simulation = {**small_rig.RIG["simulation"], "warm_up_drift": 0.0}
    values = {**small_rig.RIG["light"], "warm_up_s": 0.0, **light}
    return validate(RigConfig, {**small_rig.RIG, "light": values, "simulation": simulation})


def protocol_config(**bracket: Any) -> ProtocolConfig:
    return validate(ProtocolConfig, {**PROTOCOL, "bracket": {**PROTOCOL["bracket"], **bracket}})


@dataclass
class FaultyBench:
    """A simulated rig with faults, and the world behind it to look at."""

    faults: tuple[Fault, ...] = ()
    world: World | None = None

    def devices(self, rig: Mapping[str, Any]) -> Devices:
        self.world, camera, light, stage = open_faulty(rig, self.faults, VirtualClock())
        return Devices(camera, light, stage, self.world.clock)


@dataclass(frozen=True)
class Run:
    """What became of one capture."""

    path: Path
    world: World
    finish: Finish | None
    message: str
    warnings: tuple[str, ...] = ()

    @property
    def struck(self) -> bool:
        return bool(self.world.strikes)

    @property
    def light_after(self) -> float | None:
        """Seconds for which the light shone on after the first fault; None if it was dark then."""
        struck = self.world.strikes[0][0]
        lit = [end - struck for begin, end in self.lit_times if begin <= struck <= end]
        return max(lit) if lit else None

    @property
    def lit_times(self) -> list[tuple[float, float]]:
        return list(self.world.lamp.history)

    @property
    def is_dark(self) -> bool:
        return self.world.lamp.level == 0.0


def run(
    path: Path,
    *faults: Fault,
    rig: RigConfig | None = None,
    watcher: Watcher | None = None,
    bench_class: type[FaultyBench] = FaultyBench,
    **bracket: Any,
) -> Run:
    """Capture with faults; return what became of it, whatever that is (`finish` is None if it was refused)."""
    bench = bench_class(faults)
    try:
        outcome = capture(rig or rig_config(), protocol_config(**bracket), path, watcher, bench.devices)
    except CaptureFaultError as error:
        outcome = Outcome(Finish.FAULT, path, 0, 3, str(error))
    except DeviceError as error:
        assert bench.world is not None
        return Run(path, bench.world, None, str(error))
    assert bench.world is not None
    return Run(path, bench.world, outcome.finish, outcome.message, outcome.warnings)


def content(path: Path) -> dict[str, object]:
    return small_rig.content(path)


def resumed(path: Path) -> dict[str, object]:
    """Finish a session on a rig without faults, if it is not complete, and return its content."""
    resume(path, devices=FaultyBench().devices)
    assert list(verify_session(path)) == []
    return content(path)


def n_complete(path: Path) -> int:
    with Session(path) as session:
        return int(session.pose_complete.sum())


def only_whole_poses(path: Path) -> bool:
    """Whether every pose that counts as complete has all its frames."""
    with Session(path) as session:
        return bool(session.frame_ok[session.pose_complete].all())


def capture_and_die(path: str, number: int) -> None:
    """Capture, and end by SIGKILL before write `number` to the file (in a process of its own)."""
    _die_at_write(number)
    capture(rig_config(), protocol_config(), path, devices=FaultyBench().devices)


def resume_and_die(path: str, number: int) -> None:
    """Resume, else as `capture_and_die`."""
    _die_at_write(number)
    resume(path, devices=FaultyBench().devices)


def _die_at_write(number: int) -> None:
    write, n_writes = Recorder._write, 0

    def write_or_die(self: Recorder, field: Field, value: object, at: object = ()) -> None:
        nonlocal n_writes
        if n_writes == number:
            os.kill(os.getpid(), signal.SIGKILL)
        n_writes += 1
        write(self, field, value, at)

    Recorder._write = write_or_die  # type: ignore[method-assign]


def hold_rig(flag: str) -> None:
    """Hold the rig until killed (in a process of its own); `flag` is a file to say that it is held."""
    with Rig.connected(rig_config(), FaultyBench().devices):
        Path(flag).touch()
        time.sleep(3600.0)


def capture_on_full_disk(path: str, said: str, n_bytes: int, others: Path | None) -> None:
    """Capture where files may not grow beyond `n_bytes`, or where file `others` takes all space after a pose."""
    signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    write_pose, faulty = Recorder.write_pose, FaultyBench()

    def write_pose_and_fill(self: Recorder, i_pose: int, record: PoseRecord, events: Sequence[str]) -> None:
        if i_pose == 1 and others is not None:
            others.write_bytes(bytes(shutil.disk_usage(others.parent).free))
        write_pose(self, i_pose, record, events)

    Recorder.write_pose = write_pose_and_fill  # type: ignore[method-assign]
    if n_bytes:
        resource.setrlimit(resource.RLIMIT_FSIZE, (n_bytes, resource.RLIM_INFINITY))
    try:
        capture(rig_config(), protocol_config(), path, devices=faulty.devices)
    except OSError as error:
        assert faulty.world is not None
        Path(said).write_text(f"{error} lit: {faulty.world.lamp.level > 0.0}")
