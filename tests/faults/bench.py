"""Captures on a simulated rig that goes wrong by a script, and what to hold against their outcome."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.errors import DeviceError
from drivers.registry import Devices
from drivers.simulated.clock import VirtualClock
from drivers.simulated.devices import open_faulty
from drivers.simulated.faults import Fault
from drivers.simulated.world import World
from instrument.config import ProtocolConfig, RigConfig
from instrument.config_problems import validate
from instrument.session import Session
from instrument.verify import verify_session
from protocols.engine import CaptureFaultError, Finish, Outcome, capture, resume
from protocols.progress import Watcher
from tests.campaigns import small_rig

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
    path: Path, *faults: Fault, rig: RigConfig | None = None, watcher: Watcher | None = None, **bracket: Any
) -> Run:
    """Capture with faults; return what became of it, whatever that is (`finish` is None if it was refused)."""
    bench = FaultyBench(faults)
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
