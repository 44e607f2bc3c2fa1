"""Every fault that can be injected, in the banner: what it is, of which device, and what comes next."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from pytestqt.qtbot import QtBot

from drivers.camera import Frame
from drivers.simulated.camera import SimulatedCamera
from drivers.simulated.faults import EFFECTS, Fault
from gui.main_window import MainWindow
from gui.rig.light_sign import LightSign
from protocols.capture import run
from tests.faults.bench import rig_config
from tests.faults.conftest import impatient
from tests.faults.test_devices import ALWAYS, FIRST_POSE, NEVER_BACK, SECOND_POSE
from tests.gui.faulty_bench import FaultyBench

PROTOCOL = """
name = "three views"
bracket = { exposure_times_s = [0.002, 0.01, 0.05], darks = 2 }
rings = [{ tilt_deg = 25.0, count = 3, start_deg = 10.0 }]
"""
AGAIN = "is repeated"
RESUME = "Go on with: halfangle resume"

# The fault, what the banner says of it, and what it says comes next: the program's act or the operator's.
SHOWN = [
    (Fault("camera", "error", "trigger", 8), "the simulated camera", AGAIN),
    (Fault("camera", "garbage", "trigger", 8), "the simulated camera answered trigger with nonsense", AGAIN),
    (Fault("camera", "lost", "trigger", 8, value=2), "the simulated camera is not there", AGAIN),
    (Fault("camera", "lost", "trigger", 8, value=NEVER_BACK), "a device is gone and did not come back", RESUME),
    (Fault("camera", "denied", "connect", 0), "the simulated camera", "permission"),
    (Fault("camera", "no_answer", "trigger", 8), "the simulated camera did not answer trigger within 1 s", AGAIN),
    (Fault("camera", "hang", "trigger", 8), "camera", AGAIN),
    (Fault("camera", "other_serial", "describe", after=0.3, repeats=ALWAYS), "the camera is 'another camera'", RESUME),
    (Fault("camera", "dropped_frame", "trigger", 8), "frame", AGAIN),
    (Fault("camera", "repeated_frame", "trigger", 8), "frame", AGAIN),
    (Fault("camera", "stale_frame", "trigger", 8), "frame", AGAIN),
    (Fault("camera", "torn_frame", "trigger", 8, repeats=ALWAYS), "the camera delivered uint16 of shape", RESUME),
    (
        Fault("camera", "clipped_frame", "trigger", SECOND_POSE, repeats=3),
        "pose 1: 100.0% of",
        "Add a shorter exposure",
    ),
    (
        Fault("camera", "black_frame", "trigger", FIRST_POSE, repeats=ALWAYS),
        "the picture is black",
        "Is the lens cap on?",
    ),
    (Fault("light", "error", "on", 1), "the simulated light", AGAIN),
    (Fault("light", "garbage", "read", 4), "the simulated light answered read with nonsense", AGAIN),
    (Fault("light", "lost", "on", 1, value=2), "the simulated light is not there", AGAIN),
    (Fault("light", "denied", "connect", 0), "the simulated light", "permission"),
    (Fault("light", "no_answer", "on", 1), "the simulated light did not answer on within 1 s", AGAIN),
    (Fault("light", "hang", "on", 1), "light", AGAIN),
    (Fault("light", "other_serial", "describe", after=0.3, repeats=ALWAYS), "the light is 'another light'", RESUME),
    (
        Fault("light", "stays_dark", "on", 1, repeats=ALWAYS),
        "the light was told to shine and reports that it is",
        RESUME,
    ),
    (Fault("light", "dead", "on", 1, repeats=ALWAYS), "the picture is black", RESUME),
    (Fault("light", "stays_on", "off", 4, repeats=ALWAYS), "NOT SAFE", "Switch it off by hand"),
    (Fault("light", "stuck", "off", 4, repeats=ALWAYS), "light", "Switch it off by hand"),
    (Fault("light", "drift", "on", 1, value=0.2), "the light's monitor changed by", "pose"),
    (Fault("stage", "error", "move", 1), "the simulated stage", AGAIN),
    (Fault("stage", "garbage", "read", 1, repeats=ALWAYS), "the simulated stage answered read with nonsense", RESUME),
    (Fault("stage", "lost", "move", 1, value=3), "the simulated stage is not there", AGAIN),
    (Fault("stage", "denied", "connect", 0), "the simulated stage", "permission"),
    (Fault("stage", "no_answer", "move", 1), "the simulated stage did not answer move within 1 s", AGAIN),
    (Fault("stage", "hang", "read", 1), "stage", AGAIN),
    (Fault("stage", "other_serial", "describe", after=0.3, repeats=ALWAYS), "the stage is 'another stage'", RESUME),
    (Fault("stage", "stall", "move", 1, repeats=ALWAYS), "the simulated stage stalled", RESUME),
    (Fault("stage", "slip", "move", 1), "axis 'tilt' reads", AGAIN),
    (Fault("stage", "alarm", "move", 1, repeats=ALWAYS), "the simulated stage hit the limit switch", RESUME),
]


__all__ = ["impatient"]


@pytest.fixture
def bench() -> FaultyBench:
    return FaultyBench()


@pytest.fixture
def window(bench: FaultyBench, qtbot: QtBot, tmp_path: Path) -> Iterator[MainWindow]:
    (tmp_path / "protocol.toml").write_text(PROTOCOL)
    window = MainWindow(rig_config(), bench.devices)
    window.show()
    qtbot.waitUntil(window.controls.live_button.isEnabled)
    window.protocol_panel.protocol_edit.setText(str(tmp_path / "protocol.toml"))
    window.protocol_panel.session_edit.setText(str(tmp_path / "session.h5"))
    yield window
    window.close()
    window.deleteLater()


def capture(window: MainWindow, qtbot: QtBot) -> None:
    window.protocol_panel.start_button.click()
    qtbot.waitUntil(lambda: not window.rig_use.is_busy and window.controls.live_button.isEnabled(), timeout=60_000)


def test_every_effect_of_every_device_is_among_them():
    assert {(fault.device, fault.effect) for fault, *_ in SHOWN} == {
        (device, effect) for device, effects in EFFECTS.items() for effect in effects
    }


# Three effects in the fast suite, all in the longer one: a window for each takes its time.
FAST = ("lost", "stays_on", "alarm")
CASES = [
    pytest.param(
        fault,
        *texts,
        id=f"{fault.device} {fault.effect} {fault.value:g}",
        marks=[] if fault.effect in FAST else pytest.mark.slow,
    )
    for fault, *texts in SHOWN
]


@pytest.mark.parametrize(("spoil", "what", "next_"), CASES)
def test_a_fault_stands_in_the_banner_with_what_and_what_next(
    window: MainWindow,
    bench: FaultyBench,
    qtbot: QtBot,
    request: pytest.FixtureRequest,
    spoil: Fault,
    what: str,
    next_: str,
):
    if spoil.effect == "hang":
        request.getfixturevalue("impatient")
    # To be another one, it has to be connected once more.
    gone = (Fault("camera", "lost", "trigger", 8),) if spoil.effect == "other_serial" else ()
    bench.faults = (*gone, spoil)
    capture(window, qtbot)
    assert bench.worlds[1].strikes
    assert window.banner.isVisible()
    assert what in window.banner.text()
    assert next_ in window.banner.text()
    assert window.light_label.text() == LightSign.OFF.value


def test_a_capture_without_a_fault_leaves_the_banner_hidden(window: MainWindow, qtbot: QtBot):
    capture(window, qtbot)
    assert not window.banner.isVisible()


class DyingCamera(SimulatedCamera):
    """Has an error that no driver should have."""

    def trigger(self) -> Frame:
        raise ZeroDivisionError("a programmer's error")


def test_the_light_is_off_when_the_live_pictures_thread_dies(window: MainWindow, bench: FaultyBench, qtbot: QtBot):
    bench.camera = DyingCamera
    window.acquisition.close()
    qtbot.waitUntil(window.controls.connect_button.isEnabled)
    window.controls.connect_button.click()
    qtbot.waitUntil(window.controls.live_button.isEnabled)
    window.controls.live_button.click()
    qtbot.waitUntil(window.banner.isVisible)
    qtbot.waitUntil(window.controls.connect_button.isEnabled)
    assert "a programmer's error" in window.banner.text()
    assert not bench.lit


def test_the_light_is_off_when_the_captures_thread_dies(
    window: MainWindow, bench: FaultyBench, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
):
    take = run.take_pose

    def take_and_die(*args: Any) -> Any:
        take(*args)
        bench.worlds[1].lamp.shine(1.0, 1e6)
        raise ZeroDivisionError("a programmer's error")

    monkeypatch.setattr(run, "take_pose", take_and_die)
    capture(window, qtbot)
    assert "a programmer's error" in window.banner.text()
    assert RESUME in window.banner.text()
    assert not bench.lit
    assert window.light_label.text() == LightSign.OFF.value
