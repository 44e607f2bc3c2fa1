"""A session is calibrated, reconstructed and reported by clicks, and its points are looked at."""

from pathlib import Path

import h5py
import pytest
from pytestqt.qtbot import QtBot

from benchmarks.common.simulated import EXAMPLES
from drivers.registry import open_devices
from gui.main_window import MainWindow
from gui.sessions.table import FILE
from instrument.config.loading import load_protocol, load_rig
from instrument.session import layout
from protocols.capture import engine
from tests.end_to_end.test_chain import PROTOCOL
from tests.gui.test_main_window import bench, window

__all__ = ["bench", "window"]

# Each step is the command itself, on a session of a real size.
pytestmark = pytest.mark.slow


def test_a_session_becomes_a_result_whose_points_show_their_samples(window: MainWindow, qtbot: QtBot, tmp_path: Path):
    (tmp_path / "few.toml").write_text(PROTOCOL.replace("count = 6", "count = 3"))
    rig = load_rig(EXAMPLES / "simulated.toml")
    engine.capture(rig, load_protocol(tmp_path / "few.toml"), tmp_path / "s.h5", devices=open_devices)
    with h5py.File(tmp_path / "s.h5", "r+") as file:
        # A part of the area, at a pitch as captures from elsewhere state it; the whole of it takes minutes.
        file[layout.AREA.path][...] = 40.0
        file.create_dataset(layout.PIXEL_PITCH.path, data=1.0).attrs["units"] = "mm"
    sessions = window.sessions_tab
    window.tabs.setCurrentWidget(sessions)
    sessions.folder_edit.setText(str(tmp_path))
    sessions.look_button.click()
    qtbot.waitUntil(lambda: sessions.table.rowCount() == 1, timeout=20_000)
    sessions.table.selectRow(0)
    assert sessions.table.item(0, FILE).text() == "s.h5"

    with qtbot.waitSignal(window.calibration_tab.shown, timeout=200_000):
        sessions.reprocessing.calibrate_button.click()
    assert window.tabs.currentWidget() is window.calibration_tab
    assert len(window.calibration_tab.calibration.views) == 12
    assert "0 FAIL" in window.calibration_tab.state_label.text()

    qtbot.waitUntil(sessions.reprocessing.reconstruct_button.isEnabled, timeout=20_000)
    with qtbot.waitSignal(window.result_tab.shown, timeout=200_000):
        sessions.reprocessing.reconstruct_button.click()
    assert str(tmp_path / "s.stack.h5") in sessions.reprocessing.command_edit.text()
    grid = window.result_tab.result.grid
    with qtbot.waitSignal(window.result_tab.point.sampling.done, timeout=60_000):
        window.result_tab.pick(grid.height // 2, grid.width // 2)
    assert "samples used" in window.result_tab.point.samples_label.text()

    qtbot.waitUntil(sessions.reprocessing.report_button.isEnabled, timeout=20_000)
    with qtbot.waitSignal(sessions.reprocessing.ended, timeout=60_000):
        sessions.reprocessing.report_button.click()
    assert (tmp_path / "s.html").exists()
    assert "halfangle report" in window.log_panel.text.toPlainText()
    assert not window.banner.isVisible()
