"""Sessions, calibration and result within the window: what one finds, the others show."""

from pathlib import Path

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QApplication, QWidget
from pytestqt.qtbot import QtBot

from gui.main_window import MainWindow
from gui.widgets.command import Command
from tests.gui.test_main_window import bench, window

__all__ = ["bench", "window"]


def tabs_of(window: MainWindow) -> list[QWidget]:
    return [window.sessions_tab, window.calibration_tab, window.result_tab]


def test_what_is_asked_for_is_opened_and_turned_to(window: MainWindow, qtbot: QtBot, tmp_path: Path):
    asks = {
        window.calibration_tab: window.sessions_tab.calibration_asked,
        window.result_tab: window.sessions_tab.result_asked,
    }
    for tab, asked in asks.items():
        window.tabs.setCurrentWidget(window.sessions_tab)
        with qtbot.waitSignal(tab.failed, timeout=20_000):
            asked.emit(tmp_path / "gone.h5")
        assert window.tabs.currentWidget() is tab
        assert "gone.h5" in window.banner.text()


def test_nobody_is_torn_from_the_live_picture(window: MainWindow, qtbot: QtBot, tmp_path: Path):
    window.tabs.setCurrentWidget(window.live_view)
    with qtbot.waitSignal(window.result_tab.failed, timeout=20_000):
        window.sessions_tab.result_asked.emit(tmp_path / "gone.h5")
    assert window.tabs.currentWidget() is window.live_view


def test_what_a_command_prints_stands_in_the_log(window: MainWindow):
    window.sessions_tab.reprocessing.line.emit("halfangle report a.result.h5 -o a.html")
    assert "halfangle report a.result.h5 -o a.html" in window.log_panel.text.toPlainText()


def test_a_session_without_a_calibration_is_calibrated_from_its_tab(window: MainWindow, qtbot: QtBot, tmp_path: Path):
    with qtbot.waitSignal(window.sessions_tab.failed, timeout=20_000) as failed:
        window.calibration_tab.calibrate_asked.emit(tmp_path / "gone.h5")
    assert "gone.h5" in failed.args[0]


def test_the_window_closes_while_a_command_runs_and_ends_it(window: MainWindow, qtbot: QtBot, tmp_path: Path):
    panel = window.sessions_tab.reprocessing
    with qtbot.waitSignal(panel.line, timeout=20_000):
        panel.reconstruct(tmp_path / "a.stack.h5")
    (command,) = panel.findChildren(Command)
    window.close()
    assert not command.is_running


def reached_by_tab(part: QWidget) -> set[QWidget]:
    """Return what of a window the Tab key comes by, from where it starts."""
    part.window().activateWindow()
    passed: list[QWidget] = []
    while (now := QApplication.focusWidget()) not in passed:
        passed.append(now)
        part.window().focusNextChild()
    return set(passed)


def test_everything_is_reached_with_the_tab_key_alone(window: MainWindow, qtbot: QtBot):
    for part in (*tabs_of(window), window.protocol_panel):
        if part is not window.protocol_panel:
            window.tabs.setCurrentWidget(part)
        wanted = {
            widget
            for widget in part.findChildren(QWidget)
            if widget.focusPolicy() & Qt.FocusPolicy.TabFocus
            and widget.isVisible()
            and widget.isEnabled()
            and widget.focusProxy() is None
        }
        assert wanted
        assert wanted - reached_by_tab(part) == set()


def test_the_tabs_leave_room_on_a_small_screen(window: MainWindow):
    for tab in tabs_of(window):
        hint = tab.minimumSizeHint()
        assert hint.width() <= 320, tab
        assert hint.height() <= 320, tab
