"""Sessions are listed, verified and taken up again from the window."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot

from drivers.registry import open_devices
from gui.reprocessing import ReprocessingPanel
from gui.sessions_tab import SessionsTab
from gui.sessions_table import BEGUN, FILE, POSES, STATE, TITLE
from instrument.config import load_protocol
from protocols import engine
from tests.cli.test_capture import PROTOCOL
from tests.gui.test_main_window import rig_config


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sessions")
    (folder / "protocol.toml").write_text(PROTOCOL)
    engine.capture(rig_config(), load_protocol(folder / "protocol.toml"), folder / "whole.h5", devices=open_devices)
    (folder / "damaged.h5").write_bytes((folder / "whole.h5").read_bytes()[:5000])
    return folder


@pytest.fixture
def tab(folder: Path, qtbot: QtBot) -> Iterator[SessionsTab]:
    tab = SessionsTab()
    qtbot.addWidget(tab)
    tab.folder_edit.setText(str(folder))
    tab.look()
    qtbot.waitUntil(lambda: tab.table.rowCount() == 2, timeout=20_000)
    qtbot.waitUntil(tab.look_button.isEnabled)
    yield tab
    tab.close_job()


def cell(tab: SessionsTab, row: int, column: int) -> str:
    return str(tab.table.item(row, column).text())


def column(tab: SessionsTab, number: int) -> dict[str, str]:
    return {cell(tab, row, FILE): cell(tab, row, number) for row in range(tab.table.rowCount())}


def select(tab: SessionsTab, name: str) -> None:
    tab.table.selectRow(list(column(tab, FILE)).index(name))


def test_each_file_is_listed_with_its_state(tab: SessionsTab):
    assert column(tab, STATE) == {"damaged.h5": "✗ damaged", "whole.h5": "✓ complete"}
    assert column(tab, POSES)["whole.h5"] == "3 of 3"
    assert re.fullmatch(r"20\d\d-\d\d-\d\d \d\d:\d\d", column(tab, BEGUN)["whole.h5"])
    assert "cut short" in column(tab, TITLE)["damaged.h5"]


def test_a_session_has_its_picture_and_a_damaged_file_has_none(tab: SessionsTab):
    has_picture = {cell(tab, row, FILE): not tab.table.item(row, FILE).icon().isNull() for row in range(2)}
    assert has_picture == {"damaged.h5": False, "whole.h5": True}


def test_nothing_can_be_done_with_nothing(tab: SessionsTab):
    assert not tab.verify_button.isEnabled()
    select(tab, "whole.h5")
    assert tab.verify_button.isEnabled()
    tab.table.clearSelection()
    assert not any(b.isEnabled() for b in (tab.verify_button, tab.use_button, tab.reprocessing.calibrate_button))


@pytest.mark.parametrize(("name", "verdict"), [("whole.h5", "every check passed"), ("damaged.h5", "damaged.h5")])
def test_a_session_is_verified_in_the_background(tab: SessionsTab, qtbot: QtBot, name: str, verdict: str):
    select(tab, name)
    tab.verify_button.click()
    assert not tab.look_button.isEnabled()
    qtbot.waitUntil(lambda: tab.found_label.text() != "", timeout=20_000)
    assert verdict in tab.found_label.text()
    qtbot.waitUntil(tab.look_button.isEnabled)


def test_the_chosen_session_is_handed_on(tab: SessionsTab, qtbot: QtBot, folder: Path):
    select(tab, "whole.h5")
    with qtbot.waitSignal(tab.chosen) as chosen:
        tab.use_button.click()
    assert chosen.args == [folder / "whole.h5"]


def test_a_result_is_shown_as_one_and_a_session_by_its_calibration(tab: SessionsTab, qtbot: QtBot, folder: Path):
    select(tab, "whole.h5")
    with qtbot.waitSignal(tab.calibration_asked) as asked:
        tab.show_button.click()
    assert asked.args == [folder / "whole.h5"]
    tab.table.show_files([{"path": "/a.result.h5", "state": "other", "problems": [("/a.result.h5", "no session")]}], {})
    tab.table.selectRow(0)
    with qtbot.waitSignal(tab.result_asked) as asked:
        tab.show_button.click()
    assert asked.args == [Path("/a.result.h5")]


def test_a_folder_that_is_none_is_said(tab: SessionsTab, qtbot: QtBot):
    tab.folder_edit.setText("/no/such/folder")
    with qtbot.waitSignal(tab.failed) as failed:
        tab.look_button.click()
    assert "/no/such/folder is no folder" in failed.args[0]
    qtbot.waitUntil(tab.look_button.isEnabled)


@pytest.fixture
def copied(tab: SessionsTab, folder: Path, qtbot: QtBot, tmp_path: Path) -> Path:
    """Show a folder with one session, and select that."""
    shutil.copy(folder / "whole.h5", tmp_path / "my session.h5")
    tab.folder_edit.setText(str(tmp_path))
    tab.look()
    qtbot.waitUntil(lambda: tab.table.rowCount() == 1, timeout=20_000)
    qtbot.waitUntil(tab.look_button.isEnabled)
    select(tab, "my session.h5")
    return tmp_path / "my session.h5"


def test_a_file_that_vanished_is_a_message(tab: SessionsTab, qtbot: QtBot, copied: Path):
    copied.unlink()
    for button in (tab.verify_button, tab.reprocessing.calibrate_button, tab.reprocessing.reconstruct_button):
        qtbot.waitUntil(button.isEnabled)
        with qtbot.waitSignal(tab.failed, timeout=20_000) as failed:
            button.click()
        assert "my session.h5" in failed.args[0]


def test_a_command_shows_its_line_its_output_and_why_it_failed(tab: SessionsTab, qtbot: QtBot, copied: Path):
    panel, lines = tab.reprocessing, []
    tab.line.connect(lines.append)
    with qtbot.waitSignal(tab.failed, timeout=60_000) as failed:
        panel.calibrate_button.click()
        assert not panel.report_button.isEnabled()
    stack = copied.with_name("my session.stack.h5")
    assert panel.command_edit.text().startswith(f"halfangle calibrate '{copied}' -o '{stack}' --report ")
    assert lines[0] == panel.command_edit.text()
    assert "ended with exit code 2" in failed.args[0]
    assert lines[-1] in failed.args[0]
    assert "exit code 2" in panel.state_label.text()
    assert not stack.exists()
    qtbot.waitUntil(panel.calibrate_button.isEnabled)


def test_a_report_without_a_result_is_refused_before_anything_runs(tab: SessionsTab, qtbot: QtBot, copied: Path):
    with qtbot.waitSignal(tab.failed, timeout=20_000) as failed:
        tab.reprocessing.report_button.click()
    assert "has no result; reconstruct it" in failed.args[0]
    assert tab.reprocessing.command_edit.text() == ""


def test_a_command_is_ended_and_is_no_failure(qtbot: QtBot, copied: Path, tab: SessionsTab):
    panel: ReprocessingPanel = tab.reprocessing
    with qtbot.waitSignal(panel.line, timeout=20_000):
        panel.calibrate_button.click()
    failures: list[str] = []
    panel.failed.connect(failures.append)
    with qtbot.waitSignal(panel.ended, timeout=20_000):
        panel.end_button.click()
    assert panel.state_label.text() == "ended before it was done"
    assert failures == []
