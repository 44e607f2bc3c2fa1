from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drivers.clock import RealClock
from drivers.light import LightState
from drivers.registry import open_devices
from drivers.simulated.clock import VirtualClock
from instrument.config.protocol import WatchConfig
from instrument.rig.rig import Rig
from protocols.acquisition.warm_up import WINDOW, slope_per_minute, warm_up
from protocols.capture.engine import Control, Finish, Progress, State, capture
from tests.faults.bench import FaultyBench, protocol_config, rig_config
from tests.protocols.fakes import FakeBench, FakeCamera, FakeLight, FakeStage
from tests.protocols.fakes import rig_config as fake_config


def nothing() -> None:
    """Nobody asks for anything."""


def simulated(drift: float, takes: float, **light: Any) -> Any:
    rig = rig_config(**light)
    lamp = rig.simulation.model_copy(update={"warm_up_drift": drift, "warm_up_s": takes})
    return Rig.connected(rig.model_copy(update={"simulation": lamp}), open_devices)


def test_a_light_is_warm_when_its_monitor_is_steady() -> None:
    with simulated(0.05, 100.0, warm_up_s=100.0, steady_per_minute=1e-4) as rig:
        done = warm_up(rig, nothing)
        assert done.steady
        assert 95.0 < done.seconds < 120.0
        assert not rig.light.read().lit


def test_a_light_that_is_steady_from_the_start_takes_a_few_readings() -> None:
    with simulated(0.0, 100.0, warm_up_s=100.0) as rig:
        assert warm_up(rig, nothing).seconds == 2.0 * WINDOW


def test_a_light_that_never_gets_steady_is_told_so_after_twice_the_rated_time() -> None:
    with simulated(0.5, 1e5, warm_up_s=30.0, steady_per_minute=1e-4) as rig:
        done = warm_up(rig, nothing)
    assert not done.steady
    assert done.seconds == 60.0
    assert done.slope < 0.0


def test_a_light_without_a_monitor_shines_for_the_rated_time(monkeypatch: pytest.MonkeyPatch) -> None:
    bench, config = FakeBench(), fake_config()
    light = config.light.model_copy(update={"warm_up_s": 12.0})
    monkeypatch.setattr(FakeLight, "_state", lambda self: LightState(bench.lit, 1.0, np.nan, np.nan))
    fakes = FakeCamera(bench), FakeLight(bench), FakeStage(bench)
    done = warm_up(Rig(config.model_copy(update={"light": light}), *fakes, VirtualClock()), nothing)
    assert done.seconds == 12.0
    assert done.steady


def test_the_slope_is_that_of_a_straight_line() -> None:
    readings = [1.0 + 0.003 * i for i in range(WINDOW)]
    assert slope_per_minute(readings) == pytest.approx(30 * 0.003 / np.mean(readings))
    assert np.isnan(slope_per_minute(readings[:-1]))
    assert isinstance(RealClock().now(), float)


def test_a_pause_that_is_asked_for_ends_the_warm_up_in_the_dark(tmp_path: Path) -> None:
    bench, control, seen = FaultyBench(), Control(), list[State]()

    def watch(progress: Progress) -> None:
        seen.append(progress.state)
        if progress.state is State.WARMUP:
            control.pause()

    rig = rig_config(warm_up_s=1e6)
    cold = rig.simulation.model_copy(update={"warm_up_drift": 0.5, "warm_up_s": 1e7})
    rig = rig.model_copy(update={"simulation": cold})
    outcome = capture(rig, protocol_config(), tmp_path / "s.h5", watch, bench.devices, control)
    assert outcome.finish is Finish.PAUSED
    assert State.WARMUP in seen
    assert bench.world is not None
    assert bench.world.lamp.level == 0.0


def test_a_pause_that_is_asked_for_ends_the_wait_for_the_next_pose(tmp_path: Path) -> None:
    bench, control = FaultyBench(), Control()
    watch = WatchConfig(repeats=3, interval_s=1e5)

    def ask(progress: Progress) -> None:
        if progress.message == "pose 2 of 9":
            control.pause()

    protocol = protocol_config().model_copy(update={"watch": watch})
    outcome = capture(rig_config(), protocol, tmp_path / "s.h5", ask, bench.devices, control)
    assert (outcome.finish, outcome.n_complete) == (Finish.PAUSED, 1)
    assert outcome.seconds < 1000.0
