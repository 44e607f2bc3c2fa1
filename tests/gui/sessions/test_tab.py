"""Sessions are listed, verified and taken up again from the window."""

import re
import shutil
from collections.abc import Iterator
from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot

from drivers.registry import open_devices
from gui.sessions.tab import Files, SessionsTab, files_of
from gui.sessions.table import BEGUN, FILE, POSES, STATE, TITLE
from gui.widgets import command
from instrument.config.loading import load_protocol
from protocols.capture import engine
from tests.cli.test_capture import PROTOCOL
from tests.gui.test_main_window import rig_config


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sessions")
    (folder / "protocol.toml").write_text(PROTOCOL)
    engine.capture(rig_config(), load_protocol(folder / "protocol.toml"), folder / "whole.h5", devices=open_devices)
    (folder / "damaged.h5").write_bytes((folder / "whole.h5").read_bytes()[:5000])
    return folder


@pytest.fixture(scope="module")
def files(folder: Path) -> Files:
    return files_of(folder)


@pytest.fixture
def tab(folder: Path, files: Files, qtbot: QtBot) -> Iterator[SessionsTab]:
    """Show what is found in the folder, which was looked at once."""
    tab = SessionsTab()
    qtbot.addWidget(tab)
    tab.folder_edit.setText(str(folder))
    tab.table.show_files(files.rows, files.pictures)
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
    paths = ("/a.result.h5", "/a.stack.h5", "/a.h5")
    other = [{"path": path, "state": "other", "problems": [(path, "holds brdf")]} for path in paths]
    tab.table.show_files(other, {})
    assert [cell(tab, row, STATE) for row in range(3)] == ["– result", "– stack", "– no session"]
    assert [cell(tab, row, TITLE) for row in range(3)] == ["", "", "holds brdf"]
    select(tab, "a.result.h5")
    with qtbot.waitSignal(tab.result_asked) as asked:
        tab.show_button.click()
    assert asked.args == [Path("/a.result.h5")]


def test_a_folder_is_looked_at_in_the_background(tab: SessionsTab, qtbot: QtBot):
    shown = [column(tab, number) for number in (STATE, POSES, TITLE)]
    tab.table.setRowCount(0)
    tab.look_button.click()
    assert not tab.look_button.isEnabled()
    qtbot.waitUntil(lambda: tab.table.rowCount() == 2, timeout=20_000)
    assert [column(tab, number) for number in (STATE, POSES, TITLE)] == shown
    qtbot.waitUntil(tab.look_button.isEnabled)


def test_a_folder_that_is_none_is_said(tab: SessionsTab, qtbot: QtBot):
    tab.folder_edit.setText("/no/such/folder")
    with qtbot.waitSignal(tab.failed) as failed:
        tab.look_button.click()
    assert "/no/such/folder is no folder" in failed.args[0]
    qtbot.waitUntil(tab.look_button.isEnabled)


@pytest.fixture
def copied(tab: SessionsTab, folder: Path, files: Files, tmp_path: Path) -> Path:
    """Show a folder with one session, and select that."""
    path = tmp_path / "my session.h5"
    shutil.copy(folder / "whole.h5", path)
    whole = next(row for row in files.rows if row["state"] == "complete")
    # Where there is nothing to look at again after a command.
    (tmp_path / "empty").mkdir()
    tab.folder_edit.setText(str(tmp_path / "empty"))
    tab.table.show_files([whole | {"path": str(path)}], {})
    select(tab, path.name)
    return path


def test_a_file_that_vanished_is_a_message(tab: SessionsTab, qtbot: QtBot, copied: Path):
    copied.unlink()
    for button in (tab.verify_button, tab.reprocessing.calibrate_button, tab.reprocessing.reconstruct_button):
        qtbot.waitUntil(button.isEnabled)
        with qtbot.waitSignal(tab.failed, timeout=20_000) as failed:
            button.click()
        assert "my session.h5" in failed.args[0]


def test_a_command_shows_its_line_its_output_and_why_it_failed(
    tab: SessionsTab, qtbot: QtBot, copied: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(command, "_PROGRAM", ("-c", "import sys; print('first'); print('why'); sys.exit(2)"))
    panel, lines = tab.reprocessing, []
    tab.line.connect(lines.append)
    with qtbot.waitSignal(tab.failed, timeout=60_000) as failed:
        panel.calibrate_button.click()
        assert not panel.report_button.isEnabled()
    stack = copied.with_name("my session.stack.h5")
    assert panel.command_edit.text().startswith(f"halfangle calibrate '{copied}' -o '{stack}' --report ")
    assert lines == [panel.command_edit.text(), "first", "why"]
    assert failed.args[0] == f"{panel.command_edit.text()}\nended with exit code 2:\nfirst\nwhy"
    assert "exit code 2" in panel.state_label.text()
    qtbot.waitUntil(panel.calibrate_button.isEnabled)


@pytest.mark.parametrize(("button", "signal"), [("calibrate", "calibration_asked"), ("reconstruct", "result_asked")])
def test_what_a_command_made_is_asked_to_be_shown(
    tab: SessionsTab, qtbot: QtBot, copied: Path, monkeypatch: pytest.MonkeyPatch, button: str, signal: str
):
    monkeypatch.setattr(command, "_PROGRAM", ("-c", "print('done it')"))
    with qtbot.waitSignal(getattr(tab, signal), timeout=60_000) as asked:
        getattr(tab.reprocessing, f"{button}_button").click()
    made = {"calibrate": copied, "reconstruct": copied.with_name("my session.result.h5")}[button]
    assert asked.args == [made]
    assert tab.reprocessing.state_label.text() == "done: done it"


def test_a_report_without_a_result_is_refused_before_anything_runs(tab: SessionsTab, qtbot: QtBot, copied: Path):
    with qtbot.waitSignal(tab.failed, timeout=20_000) as failed:
        tab.reprocessing.report_button.click()
    assert "has no result; reconstruct it" in failed.args[0]
    assert tab.reprocessing.command_edit.text() == ""


def test_a_command_is_ended_and_is_no_failure(
    tab: SessionsTab, qtbot: QtBot, copied: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(command, "_PROGRAM", ("-c", "import time; print('begun', flush=True); time.sleep(60)"))
    panel, lines, failures = tab.reprocessing, [], []
    panel.line.connect(lines.append)
    panel.failed.connect(failures.append)
    panel.reconstruct_button.click()
    qtbot.waitUntil(lambda: "begun" in lines, timeout=20_000)
    monkeypatch.setattr(command, "PATIENCE_MS", 500)
    with qtbot.waitSignal(panel.ended, timeout=20_000):
        panel.end_button.click()
    assert panel.state_label.text() == "ended before it was done"
    assert failures == []
