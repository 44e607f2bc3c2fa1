"""What the operator is told stays until it is acknowledged, and can be read again."""

import logging
import threading

import pytest
from pytestqt.qtbot import QtBot

from gui.widgets.banner import FAULT_STYLE, WARNING_STYLE, Banner
from gui.widgets.log_panel import LogPanel, LogRelay


@pytest.fixture
def banner(qtbot: QtBot) -> Banner:
    banner = Banner()
    qtbot.addWidget(banner)
    return banner


@pytest.fixture
def panel(qtbot: QtBot) -> LogPanel:
    panel = LogPanel()
    qtbot.addWidget(panel)
    return panel


def test_a_fault_stays_beside_the_next_until_both_are_acknowledged(banner: Banner):
    banner.tell("the stage stalled. Home it")
    banner.tell("the camera is gone. Look at its cable")
    banner.tell("the stage stalled. Home it")
    assert banner.text().splitlines() == [
        "FAULT: the stage stalled. Home it",
        "FAULT: the camera is gone. Look at its cable",
    ]
    assert banner.isVisible()
    banner.acknowledge_button.click()
    assert not banner.isVisible()
    assert banner.text() == ""


def test_many_faults_leave_the_newest(banner: Banner):
    for i in range(20):
        banner.tell(f"fault {i}")
    assert banner.text().splitlines() == [f"FAULT: fault {i}" for i in range(15, 20)]


def test_a_warning_is_told_from_a_fault_by_word_and_colour(banner: Banner):
    banner.warn("the light drifts")
    assert banner.text() == "WARNING: the light drifts"
    assert (banner.is_fault, banner.styleSheet()) == (False, WARNING_STYLE)
    banner.tell("the light is gone")
    assert banner.text().splitlines() == ["WARNING: the light drifts", "FAULT: the light is gone"]
    assert (banner.is_fault, banner.styleSheet()) == (True, FAULT_STYLE)


def test_no_number_of_warnings_pushes_a_fault_out(banner: Banner):
    banner.tell("the light is gone")
    for i in range(20):
        banner.warn(f"warning {i}")
    assert banner.text().splitlines() == ["FAULT: the light is gone", *(f"WARNING: warning {i}" for i in range(16, 20))]


def test_what_looks_like_markup_is_shown_as_it_is(banner: Banner):
    banner.tell("axis <b>tilt</b> is at 3")
    assert banner.text() == "FAULT: axis <b>tilt</b> is at 3"


def test_lines_below_the_level_come_back_when_it_is_lowered(panel: LogPanel):
    panel.add(logging.DEBUG, "a detail")
    panel.add(logging.WARNING, "a warning")
    assert "a detail" not in panel.text.toPlainText()
    panel.level_box.setCurrentIndex(0)
    panel.add(logging.WARNING, "a warning")
    shown = panel.text.toPlainText().splitlines()
    assert [line.split("  ")[-1].strip() for line in shown] == ["a detail", "a warning"]
    panel.level_box.setCurrentIndex(3)
    assert panel.text.toPlainText() == ""


def test_what_another_thread_logs_arrives(panel: LogPanel, qtbot: QtBot):
    relay = LogRelay()
    relay.carrier.logged.connect(panel.add)
    record = logging.LogRecord("drivers", logging.WARNING, "", 0, "light: %s", ("disconnect failed",), None)
    thread = threading.Thread(target=relay.emit, args=(record,))
    with qtbot.waitSignal(relay.carrier.logged):
        thread.start()
    thread.join()
    qtbot.waitUntil(lambda: "light: disconnect failed" in panel.text.toPlainText())
