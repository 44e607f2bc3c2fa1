import threading

import pytest

from drivers.errors import CancelledError, DeviceError, DeviceTimeoutError
from instrument.rig.bounded import within
from instrument.rig.rig import Rig
from tests.protocols.fakes import FakeBench, rig_config


def test_what_returns_in_time_is_returned_and_what_raises_is_raised() -> None:
    assert within(5.0, "answer", lambda: 42) == 42
    with pytest.raises(ZeroDivisionError):
        within(5.0, "fail", lambda: 1 // 0)


def test_what_never_returns_is_given_up_in_time() -> None:
    never = threading.Event()
    with pytest.raises(DeviceTimeoutError, match=r"camera: frame did not end within 0.2 s"):
        within(0.2, "camera: frame", never.wait)
    never.set()


def test_a_wait_is_called_off_from_another_thread() -> None:
    never, cancel = threading.Event(), threading.Event()

    def begun() -> None:
        cancel.set()
        never.wait()

    # Nothing else would end it: the limit is an hour.
    with pytest.raises(CancelledError):
        within(3600.0, "stage: move", begun, cancel)
    never.set()


def test_nothing_is_begun_any_more_once_it_is_called_off() -> None:
    cancel, begun = threading.Event(), list[bool]()
    cancel.set()
    with pytest.raises(CancelledError):
        within(5.0, "camera: frame", lambda: begun.append(True), cancel)
    assert begun == []


def test_a_rig_that_is_called_off_still_goes_dark_and_stops() -> None:
    bench, cancel, never = FakeBench(), threading.Event(), threading.Event()
    with Rig.connected(rig_config(), bench.devices, cancel) as rig:
        rig.light.on(1.0, 5.0)
        bench.script = lambda _, name: cancel.set() or never.wait(1.0) if name == "camera.trigger" else None
        with pytest.raises(CancelledError):
            rig.camera.trigger()
    assert not bench.lit
    assert {"stage.stop", "camera.stop", "light.disconnect"} <= set(bench.calls)


def test_every_command_of_light_and_stage_and_every_failure_is_noted() -> None:
    noted: list[tuple[str, dict[str, object]]] = []

    def note(event: str, **details: object) -> None:
        noted.append((event, details))

    bench = FakeBench()
    with Rig.connected(rig_config(), bench.devices, note=note) as rig:
        rig.stage.move({"tilt": 3.0})
        rig.light.on(0.5, 2.0)
        bench.script = lambda _, name: _raise() if name == "camera.trigger" else None
        with pytest.raises(DeviceError):
            rig.camera.trigger()
        rig.light.off()
    assert [event for event, _ in noted[:4]] == ["move", "light on", "device failed", "light off"]
    assert noted[0][1] == {"tilt": 3.0}
    assert noted[1][1] == {"level": 0.5, "max_seconds": 2.0}
    assert noted[2][1]["device"] == "camera"


def _raise() -> None:
    raise DeviceError("no picture")
