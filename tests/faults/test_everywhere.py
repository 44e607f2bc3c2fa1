"""Every single fault at every call of a small capture: it ends in bounded time, dark, with a file that goes on."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from drivers.registry import Devices
from drivers.simulated.faults import EFFECTS, Fault, FaultScript
from instrument.session.session import Session
from tests.faults import bench
from tests.verifying import verify_session

CALLS = {
    "camera": ("connect", "set_exposure_time", "trigger", "stop", "disconnect"),
    "light": ("connect", "on", "off", "read", "disconnect"),
    "stage": ("connect", "home", "move", "read", "stop", "disconnect"),
}
OF_CALL = {
    "trigger": {"dropped_frame", "repeated_frame", "stale_frame", "torn_frame", "clipped_frame", "black_frame"},
    "on": {"stays_dark", "dead", "drift"},
    "off": {"stays_on", "stuck"},
    "move": {"stall", "slip", "alarm"},
}
# These change the data or the light for good, which is what they are for; they are looked at one by one elsewhere.
# A dark frame that is there twice, or of exactly the black level, is as good as another.
CHANGES_DARKS = {"stale_frame", "black_frame"}
CHANGES_DATA = {"clipped_frame", "drift", "dead"}


@pytest.fixture(scope="module")
def n_calls(tmp_path_factory: pytest.TempPathFactory) -> Counter[tuple[str, str]]:
    """How often a capture without faults calls each method."""
    counted: Counter[tuple[str, str]] = Counter()

    class Counting(FaultScript):
        def strike(self, call: str) -> Fault | None:
            counted[self.device, call] += 1
            return super().strike(call)

    class CountingBench(bench.FaultyBench):
        def devices(self, rig: Mapping[str, Any]) -> Devices:
            devices = super().devices(rig)
            for device in devices[:3]:
                device._script.__class__ = Counting
            return devices

    bench.run(tmp_path_factory.mktemp("count") / "s.h5", bench_class=CountingBench)
    return counted


def effects(device: str, call: str) -> list[str]:
    special = set().union(*OF_CALL.values())
    common = [effect for effect in EFFECTS[device] if effect not in special and effect != "other_serial"]
    return common + [effect for effect in EFFECTS[device] if effect in OF_CALL.get(call, ())]


def survives(path: Path, fault: Fault, whole: dict[str, object]) -> None:
    run = bench.run(path, fault)
    where = str(fault)
    assert run.struck, where
    if fault.call != "off":
        # A light that is not told to go off, or does not obey, shines on to the end of its lease and no longer.
        assert run.is_dark, where
    run.world.clock.sleep(10.0)
    assert run.is_dark, where
    if run.finish is None:
        # It could not be connected, or not be left: either nothing was begun or all was done.
        assert not path.exists() or bench.n_complete(path) in (0, 3), where
    if path.exists():
        assert list(verify_session(path)) == [], where
        assert bench.only_whole_poses(path), where
        if fault.effect not in CHANGES_DATA and not unnoticed(path, fault):
            after = bench.resumed(path)
            if fault.effect in CHANGES_DARKS:
                after["dark"] = whole["dark"]
            assert after == whole, where
    elif run.finish is not None:
        pytest.fail(f"{where}: {run.finish} and no file")


def unnoticed(path: Path, fault: Fault) -> bool:
    """Whether a frame was lost before the first of a set: no gap, no harm, but the simulated noise is another."""
    if fault.effect != "dropped_frame":
        return False
    with Session(path) as session:
        return not any('"event": "repeated"' in event for event in session.events)


@pytest.mark.slow
@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize(("device", "call"), [(device, call) for device, calls in CALLS.items() for call in calls])
def test_every_fault_at_every_call_is_survived(
    tmp_path: Path, whole: dict[str, object], n_calls: Counter[tuple[str, str]], device: str, call: str
) -> None:
    for number in range(n_calls[device, call]):
        for effect in effects(device, call):
            # A call that hangs takes its time each time; every fourth is tried.
            if effect == "hang" and number % 4:
                continue
            survives(tmp_path / f"{number} {effect}.h5", Fault(device, effect, call, number), whole)
