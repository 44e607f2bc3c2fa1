"""The operator's window on a small simulated rig."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from drivers.camera import Frame
from drivers.clock import RealClock
from drivers.errors import DeviceError
from drivers.limits import Limits
from drivers.readback import Setting
from drivers.registry import Devices
from drivers.simulated.camera import SimulatedCamera
from drivers.simulated.devices import open_simulated
from drivers.simulated.world import World
from gui.main_window import MainWindow
from gui.rig import acquisition
from gui.rig.light_sign import LightSign
from instrument.config.messages import validate
from instrument.config.rig import RigConfig
from tests.drivers.rigs import small_rig

SATURATION = 4095

INTERRUPTED_CONSOLE = """
import signal
from cli.main import main
from gui.main_window import MainWindow

show_rig = MainWindow._show_rig

def show_rig_and_interrupt(window, camera):
    show_rig(window, camera)
    print("interrupted", flush=True)
    signal.raise_signal(signal.SIGINT)

MainWindow._show_rig = show_rig_and_interrupt
main(["console", "--rig", "examples/simulated.toml"])
"""


class Bench:
    """Makes the devices of a small rig, and keeps the world that they share to look at."""

    def __init__(self, camera: Callable[[World], SimulatedCamera] = SimulatedCamera) -> None:
        self.world: World
        self.camera = camera

    def devices(self, rig: Mapping[str, Any]) -> Devices:
        self.world, _, light, stage = open_simulated(rig, RealClock())
        return self.camera(self.world), light, stage

    @property
    def lit(self) -> bool:
        return self.world.lamp.level > 0.0


class BrokenCamera(SimulatedCamera):
    """Delivers two frames and then no more."""

    n_frames = 0

    def trigger(self) -> Frame:
        self.n_frames += 1
        if self.n_frames > 2:
            raise DeviceError("the camera was unplugged. Plug it in and connect again.")
        return super().trigger()


def rig_config() -> RigConfig:
    rig = small_rig()
    rig["light"]["offset_sigma_mm"] = 3.0
    return validate(RigConfig, {"name": "small bench", **rig})


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def window(bench: Bench, qtbot: QtBot) -> Iterator[MainWindow]:
    yield from opened(bench, qtbot)


@pytest.fixture
def doomed(qtbot: QtBot) -> Iterator[tuple[MainWindow, Bench]]:
    bench = Bench(BrokenCamera)
    for window in opened(bench, qtbot):
        yield window, bench


def opened(bench: Bench, qtbot: QtBot) -> Iterator[MainWindow]:
    window = MainWindow(rig_config(), bench.devices)
    window.show()
    qtbot.waitUntil(window.controls.live_button.isEnabled)
    yield window
    window.close()
    # What Qt keeps of a window else, a thousand widgets each, makes every later change of colours slower.
    window.deleteLater()


def go_live(window: MainWindow, qtbot: QtBot) -> None:
    with qtbot.waitSignals([window.acquisition.frame_arrived] * 2):
        click(window.controls.live_button, qtbot)


def click(button: Any, qtbot: QtBot) -> None:
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)


def escape(window: MainWindow, qtbot: QtBot, times: int) -> None:
    """Press Esc as the desktop does: it gives keys to the window."""
    for _ in range(times):
        qtbot.keyClick(window.windowHandle(), Qt.Key.Key_Escape)


def sign(window: MainWindow) -> str:
    return window.light_label.text()


def test_opens_dark_and_names_the_camera(window: MainWindow, bench: Bench):
    assert not bench.lit
    assert sign(window) == LightSign.OFF.value
    assert "simulated camera" in window.rig_panel.labels["camera"].text()
    assert window.live_view.picture.item.image is None


def test_shows_raw_counts_with_the_light_on_once_live(window: MainWindow, bench: Bench, qtbot: QtBot):
    with qtbot.waitSignal(window.live_view.looking.done) as looked:
        go_live(window, qtbot)
    assert bench.lit
    assert sign(window) == LightSign.ON.value
    (look,) = looked.args
    assert look.counts.dtype == np.uint16
    assert look.counts.max() > 255
    assert look.image.shape == (120, 160)
    qtbot.waitUntil(lambda: window.live_view.picture.item.image is not None)


def test_triggers_in_a_thread_of_its_own(qtbot: QtBot):
    in_main_thread = []

    class ListeningCamera(SimulatedCamera):
        def trigger(self) -> Frame:
            in_main_thread.append(threading.current_thread() is threading.main_thread())
            return super().trigger()

    for window in opened(Bench(ListeningCamera), qtbot):
        go_live(window, qtbot)
    assert in_main_thread
    assert not any(in_main_thread)


def test_sends_the_exposure_time_and_shows_what_the_camera_reads_back(window: MainWindow, qtbot: QtBot):
    go_live(window, qtbot)
    with qtbot.waitSignal(window.acquisition.exposure_time_read) as read:
        window.controls.exposure_box.setValue(2.5)
    assert read.args == [pytest.approx(0.0025)]
    assert window.controls.read_back_label.text() == "2.500 ms"
    with qtbot.waitSignal(window.acquisition.frame_arrived):
        pass
    with qtbot.waitSignal(window.acquisition.frame_arrived) as arrived:
        pass
    assert arrived.args[0].exposure_time == pytest.approx(0.0025)


def test_takes_the_limits_of_the_exposure_time_from_the_camera(window: MainWindow):
    assert window.controls.exposure_box.minimum() == pytest.approx(0.01)
    assert window.controls.exposure_box.maximum() == pytest.approx(10_000.0)
    assert window.controls.exposure_box.value() == pytest.approx(10.0)


@pytest.mark.parametrize("how", ["button", "escape twice"])
def test_stop_darkens(window: MainWindow, bench: Bench, qtbot: QtBot, how: str):
    go_live(window, qtbot)
    if how == "button":
        click(window.stop_button, qtbot)
    else:
        escape(window, qtbot, 2)
    qtbot.waitUntil(lambda: sign(window) == LightSign.OFF.value)
    assert not bench.lit
    with qtbot.assertNotEmitted(window.acquisition.frame_arrived, wait=150):
        pass


def test_one_escape_alone_says_how_to_stop_and_stops_nothing(window: MainWindow, bench: Bench, qtbot: QtBot):
    go_live(window, qtbot)
    escape(window, qtbot, 1)
    assert window.statusBar().currentMessage() == "Esc once more to STOP"
    with qtbot.waitSignals([window.acquisition.frame_arrived] * 2):
        pass
    assert bench.lit


def test_two_escapes_far_apart_stop_nothing(
    window: MainWindow, bench: Bench, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("gui.rig.stop.SECOND_PRESS_S", 0.01)
    go_live(window, qtbot)
    escape(window, qtbot, 1)
    qtbot.wait(50)
    escape(window, qtbot, 1)
    with qtbot.waitSignals([window.acquisition.frame_arrived] * 2):
        pass
    assert bench.lit


def test_escape_stops_while_a_list_hangs_open(window: MainWindow, bench: Bench, qtbot: QtBot):
    go_live(window, qtbot)
    window.log_panel.level_box.showPopup()
    escape(window, qtbot, 2)
    qtbot.waitUntil(lambda: sign(window) == LightSign.OFF.value)
    assert not bench.lit


def test_goes_live_again_after_a_stop(window: MainWindow, bench: Bench, qtbot: QtBot):
    go_live(window, qtbot)
    click(window.stop_button, qtbot)
    qtbot.waitUntil(lambda: sign(window) == LightSign.OFF.value)
    go_live(window, qtbot)
    assert bench.lit


def test_stop_ends_a_long_exposure_at_once(window: MainWindow, bench: Bench, qtbot: QtBot):
    window.controls.exposure_box.setValue(10_000.0)
    click(window.controls.live_button, qtbot)
    # The sign tells it later than the lamp: an OFF of before would pass for the one that is waited for.
    qtbot.waitUntil(lambda: bench.lit and sign(window) == LightSign.ON.value)
    began = time.monotonic()
    click(window.stop_button, qtbot)
    qtbot.waitUntil(lambda: sign(window) == LightSign.OFF.value)
    assert time.monotonic() - began < 5.0  # of an exposure of ten
    assert not bench.lit
    assert window.banner.isHidden()


def test_closing_leaves_the_light_off_and_joins_the_thread(window: MainWindow, bench: Bench, qtbot: QtBot):
    go_live(window, qtbot)
    window.close()
    assert window.acquisition.isFinished()
    assert not bench.lit


def test_can_be_closed_while_the_rig_is_being_opened(bench: Bench, qtbot: QtBot):
    window = MainWindow(rig_config(), bench.devices)
    window.close()
    assert window.acquisition.isFinished()
    window.deleteLater()


def test_a_failing_camera_shows_in_the_banner_with_the_light_off(doomed: tuple[MainWindow, Bench], qtbot: QtBot):
    window, bench = doomed
    click(window.controls.live_button, qtbot)
    qtbot.waitUntil(window.acquisition.isFinished)
    qtbot.waitUntil(window.banner.isVisible)
    # The end of the thread is heard of last.
    qtbot.waitUntil(window.controls.connect_button.isEnabled)
    assert window.banner.text() == "FAULT: the camera was unplugged. Plug it in and connect again."
    assert sign(window) == LightSign.OFF.value
    assert not bench.lit
    assert not window.controls.live_button.isEnabled()


def test_connects_again_after_a_failure(doomed: tuple[MainWindow, Bench], qtbot: QtBot):
    window, _ = doomed
    click(window.controls.live_button, qtbot)
    qtbot.waitUntil(window.controls.connect_button.isEnabled)
    click(window.controls.connect_button, qtbot)
    qtbot.waitUntil(window.controls.live_button.isEnabled)
    assert window.banner.isHidden()
    assert sign(window) == LightSign.OFF.value


def test_says_that_the_light_is_unknown_where_it_cannot_be_confirmed_off(
    window: MainWindow, bench: Bench, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
):
    go_live(window, qtbot)
    monkeypatch.setattr("drivers.simulated.light.SimulatedLight.off", lambda self: self.read())
    window.acquisition.stop()
    qtbot.waitUntil(lambda: sign(window) == LightSign.UNKNOWN.value)
    monkeypatch.undo()


def test_the_light_goes_out_while_the_window_hangs_and_comes_back_with_it(
    window: MainWindow, bench: Bench, qtbot: QtBot, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(acquisition, "LEASE", 0.2)
    go_live(window, qtbot)
    time.sleep(0.6)
    assert not bench.lit
    with qtbot.waitSignals([window.acquisition.frame_arrived] * 3):
        pass
    assert "WARNING: the window asked for no frame" in window.banner.text()
    assert bench.lit
    assert sign(window) == LightSign.ON.value


def test_the_console_ends_in_order_at_ctrl_c():
    command = [sys.executable, "-c", INTERRUPTED_CONSOLE]
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen"}
    root = Path(__file__).parents[2]
    ended = subprocess.run(command, cwd=root, env=environment, capture_output=True, text=True, timeout=60, check=False)
    assert ended.returncode == 0
    assert ended.stdout == "interrupted\n"
    assert "Traceback" not in ended.stderr


def test_every_device_is_shown_with_its_serial_number_and_what_it_allows(window: MainWindow):
    texts = {kind: label.text() for kind, label in window.rig_panel.labels.items()}
    assert all(text.startswith(f"{kind.upper()}  connected") for kind, text in texts.items())
    assert all("serial number sim-5" in text for text in texts.values())
    assert "160 x 120 pixels, 12 bits" in texts["camera"]
    assert "tilt -" in texts["stage"]


def test_the_settings_of_a_device_are_shown_as_they_read_back(window: MainWindow, qtbot: QtBot):
    with qtbot.waitSignal(window.acquisition.opened) as opened_:
        window.acquisition.close()
        window.connect_rig()
    (rig,) = opened_.args
    gain = Setting("gain", 3.0, "dB", Limits(0.0, 24.0, "dB"))
    window.rig_panel.show_rig(rig._replace(camera=replace(rig.camera, settings=(gain,))))
    assert "gain 3 dB (0 to 24)" in window.rig_panel.labels["camera"].text()
