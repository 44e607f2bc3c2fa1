"""Whatever ends a capture: what is said of the light is what the lamp itself recorded, or that it is not known.

The lamp is one that shines until it is told to stop; its cable can be pulled at any moment.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import CancelledError, DeviceError, NotSafeError
from drivers.supervised_light import SupervisedLight
from instrument.session.session import Session
from protocols.capture.engine import Progress, State, capture
from protocols.capture.run import Finish
from tests.drivers.lights.serial_light_double import SerialLightDouble
from tests.protocols.fakes import FakeBench, FakeCamera, FakeStage, Script, no_fault, protocol_config, rig_config

SUPERVISOR = [sys.executable, "-m", "tests.drivers.lights.supervised_serial_light"]


class LampBench(FakeBench):
    """The fakes with a real driver of a light, which this bench sees shine."""

    def __init__(self, lamp: SerialLightDouble, script: Script) -> None:
        super().__init__(script)
        self.lamp = lamp

    def devices(self, rig: Any) -> Any:
        return FakeCamera(self), _SeenLight(self), FakeStage(self)


class _SeenLight(SupervisedLight):
    def __init__(self, bench: LampBench) -> None:
        super().__init__([*SUPERVISOR, bench.lamp.port])
        self._bench = bench

    def _ask(self, act: str, *arguments: float, **limit: float) -> Any:
        if act in ("on", "off", "read"):
            self._bench.call(f"light.{act}")
        reply = super()._ask(act, *arguments, **limit)
        self._bench.lit = self._bench.lamp.lit
        return reply

    def _tell(self, act: str, *arguments: float) -> Any:
        process = super()._tell(act, *arguments)
        if act == "on":
            self._bench.lit = True
        return process


@pytest.fixture
def lamp() -> Iterator[SerialLightDouble]:
    lamp = SerialLightDouble()
    yield lamp
    lamp.unplug()


@pytest.fixture(autouse=True)
def without_waiting(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("protocols.capture.recovery.BREATH", 0.0)
    monkeypatch.setattr("protocols.capture.recovery.RECONNECTS", 1)


def outcome(path: Path, bench: LampBench) -> tuple[str, list[Progress], bool]:
    """Capture; return what was said at the end, all progress, and whether it ended as not safe."""
    told: list[Progress] = []
    try:
        result = capture(rig_config(), protocol_config(), path, devices=bench.devices, progress=told.append)
    except (DeviceError, CancelledError, OSError) as error:
        return str(error), told, isinstance(error, NotSafeError)
    return result.message if result.finish is not Finish.COMPLETE else "The light is off", told, False


def at_nth(what: str, n: int, act: Callable[[], None]) -> Script:
    """Let `act` happen at the n-th such call, from 1."""
    seen: list[str] = []

    def script(_: int, name: str) -> None:
        seen.append(name)
        if name == what and seen.count(what) == n:
            act()

    return script


def check(path: Path, lamp: SerialLightDouble, said: str, told: list[Progress], not_safe: bool) -> None:
    assert ("The light is off" in said) != ("may still shine: switch it off by hand" in said)
    if lamp.lit:
        assert "may still shine" in said
    assert not_safe == ("NOT SAFE" in said) == (told[-1].state is State.NOT_SAFE)
    with Session(path) as session:
        events = [json.loads(event) for event in session.events]
    assert bool(events[-1].get("unsafe")) == not_safe
    if lamp.lit:
        # The last that the log says of the light is that it was to shine.
        of_light = [event for event in events if event.get("event") in ("light on", "light off")]
        assert of_light[-1]["event"] == "light on"


@pytest.mark.parametrize("number", [3, 4, 5, 6])
def test_a_cable_that_is_pulled_while_the_lamp_shines(tmp_path: Path, lamp: SerialLightDouble, number: int) -> None:
    """At a frame of a bracket: numbers 3 and 4 are the first pose's, 5 the dark look after it, 6 the next pose's."""
    bench = LampBench(lamp, at_nth("camera.trigger", number + 2, lamp.unplug))
    said, told, not_safe = outcome(tmp_path / "s.h5", bench)
    check(tmp_path / "s.h5", lamp, said, told, not_safe)


@pytest.mark.parametrize("act", ["read", "off"])
@pytest.mark.parametrize("n", [1, 3])
def test_a_cable_that_is_pulled_before_a_word_to_the_lamp(
    tmp_path: Path, lamp: SerialLightDouble, act: str, n: int
) -> None:
    said, told, not_safe = outcome(tmp_path / "s.h5", LampBench(lamp, at_nth(f"light.{act}", n, lamp.unplug)))
    check(tmp_path / "s.h5", lamp, said, told, not_safe)


@pytest.mark.parametrize("error", [KeyboardInterrupt, DeviceError, None])
def test_a_lamp_that_answers_is_known_to_be_dark(
    tmp_path: Path, lamp: SerialLightDouble, error: type[BaseException] | None
) -> None:
    def fail() -> None:
        assert error is not None
        raise error("camera.trigger failed")

    script = no_fault if error is None else at_nth("camera.trigger", 6, fail)
    said, told, not_safe = outcome(tmp_path / "s.h5", LampBench(lamp, script))
    assert not lamp.lit
    assert not not_safe
    assert "The light is off" in said
    if error is not None:
        check(tmp_path / "s.h5", lamp, said, told, not_safe)
