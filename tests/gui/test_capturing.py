"""A capture by clicks on the simulated rig: what the window asks for, what it shows, and that it ends dark."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from PySide6.QtCore import Qt
from pytestqt.qtbot import QtBot

from drivers.simulated.faults import Fault
from gui.main_window import MainWindow
from gui.rig.light_sign import LightSign
from instrument.session.session import Session
from tests.cli.test_capture import PROTOCOL
from tests.gui.faulty_bench import FaultyBench
from tests.gui.test_main_window import escape, rig_config

LONG = PROTOCOL.replace("count = 3", "count = 300")


@pytest.fixture
def bench() -> FaultyBench:
    return FaultyBench()


@pytest.fixture
def window(bench: FaultyBench, qtbot: QtBot, tmp_path: Path) -> Iterator[MainWindow]:
    window = MainWindow(rig_config(), bench.devices)
    window.show()
    qtbot.waitUntil(window.controls.live_button.isEnabled)
    write(window, tmp_path, PROTOCOL)
    yield window
    window.close()
    window.deleteLater()
    assert not bench.lit


def write(window: MainWindow, folder: Path, protocol: str) -> None:
    (folder / "protocol.toml").write_text(protocol)
    window.protocol_panel.protocol_edit.setText(str(folder / "protocol.toml"))
    window.protocol_panel.session_edit.setText(str(folder / "session.h5"))


def click(qtbot: QtBot, button: Any) -> None:
    qtbot.mouseClick(button, Qt.MouseButton.LeftButton)


def wait_for_end(window: MainWindow, qtbot: QtBot) -> None:
    qtbot.waitUntil(lambda: not window.rig_use.is_busy and window.controls.live_button.isEnabled(), timeout=60_000)


def test_a_whole_capture_by_clicks(window: MainWindow, qtbot: QtBot, tmp_path: Path):
    panel = window.protocol_panel
    click(qtbot, panel.plan_button)
    qtbot.waitUntil(lambda: "poses     3" in panel.outlook_label.text(), timeout=20_000)
    wait_for_end(window, qtbot)
    assert panel.pose_view.count_label.text() == "○ 3 planned"
    click(qtbot, panel.start_button)
    assert panel.pause_button.isEnabled()
    assert not panel.start_button.isEnabled()
    qtbot.waitUntil(lambda: window.rig_panel.labels["stage"].text() == "STAGE  in use by the capture")
    assert not window.controls.connect_button.isEnabled()
    qtbot.waitUntil(lambda: "complete" in panel.state_label.text(), timeout=60_000)
    wait_for_end(window, qtbot)
    assert (panel.bar.value(), panel.bar.maximum()) == (3, 3)
    assert window.light_label.text() == LightSign.OFF.value
    assert panel.pose_view.count_label.text() == "● 3 complete"
    assert panel.bracket_strip.title_label.text() == "Frames of pose 3"
    with Session(tmp_path / "session.h5") as session:
        assert session.pose_complete.all()


def test_a_capture_is_paused_and_resumed_by_clicks(window: MainWindow, qtbot: QtBot, tmp_path: Path):
    write(window, tmp_path, PROTOCOL.replace("count = 3", "count = 24"))
    panel = window.protocol_panel
    click(qtbot, panel.start_button)
    qtbot.waitUntil(lambda: panel.bar.value() > 0, timeout=60_000)
    click(qtbot, panel.pause_button)
    wait_for_end(window, qtbot)
    assert "paused" in panel.state_label.text()
    click(qtbot, panel.resume_button)
    qtbot.waitUntil(lambda: "24 of 24 poses, complete" in panel.state_label.text(), timeout=60_000)
    wait_for_end(window, qtbot)


@pytest.mark.parametrize("end", ["abort", "escape", "close"])
def test_whatever_ends_a_capture_early_leaves_the_light_off(
    window: MainWindow, bench: FaultyBench, qtbot: QtBot, tmp_path: Path, end: str
):
    write(window, tmp_path, LONG)
    panel = window.protocol_panel
    click(qtbot, panel.start_button)
    qtbot.waitUntil(lambda: panel.bar.value() > 0, timeout=60_000)
    if end == "close":
        window.close()
    elif end == "abort":
        click(qtbot, panel.abort_button)
        wait_for_end(window, qtbot)
        assert "halfangle resume" in panel.state_label.text()
    else:
        escape(window, qtbot, 2)
        wait_for_end(window, qtbot)
    assert not bench.lit
    with Session(tmp_path / "session.h5") as session:
        assert 0 < session.pose_complete.sum() < 300


def test_a_capture_that_waits_for_the_rig_is_not_begun_after_a_stop(
    window: MainWindow, bench: FaultyBench, qtbot: QtBot, tmp_path: Path
):
    # All in one turn of the event loop: the live picture cannot have left the rig yet.
    window.protocol_panel.start_button.click()
    assert window.rig_use.is_busy
    window.stop_button.click()
    assert not window.rig_use.is_busy
    qtbot.waitUntil(window.acquisition.isFinished)
    qtbot.wait(300)
    assert not (tmp_path / "session.h5").exists()
    assert window.controls.connect_button.isEnabled()
    assert window.protocol_panel.start_button.isEnabled()
    assert not bench.lit


def test_what_is_wrong_with_a_protocol_stands_in_the_banner_until_the_next_try(
    window: MainWindow, qtbot: QtBot, tmp_path: Path
):
    write(window, tmp_path, PROTOCOL.replace("tilt_deg = 20.0", "tilt_deg = 89.0"))
    click(qtbot, window.protocol_panel.start_button)
    wait_for_end(window, qtbot)
    assert window.banner.isVisible()
    assert "allowed is" in window.banner.text()
    write(window, tmp_path, PROTOCOL)
    click(qtbot, window.protocol_panel.plan_button)
    assert not window.banner.isVisible()
    wait_for_end(window, qtbot)


def test_the_live_picture_is_back_after_a_capture(window: MainWindow, qtbot: QtBot):
    click(qtbot, window.protocol_panel.start_button)
    qtbot.waitUntil(lambda: window.rig_use.job is not None, timeout=20_000)
    wait_for_end(window, qtbot)
    with qtbot.waitSignals([window.acquisition.frame_arrived] * 2, timeout=20_000):
        click(qtbot, window.controls.live_button)


class TestFaults:
    @pytest.fixture
    def bench(self) -> FaultyBench:
        return FaultyBench(Fault("camera", "lost", "trigger", at=8, repeats=0, value=1000.0))

    def test_a_fault_stands_in_the_banner_with_what_next(self, window: MainWindow, qtbot: QtBot):
        click(qtbot, window.protocol_panel.start_button)
        wait_for_end(window, qtbot)
        assert window.banner.isVisible()
        assert "The light is off" in window.banner.text()
        assert "halfangle resume" in window.banner.text()
