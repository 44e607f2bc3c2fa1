"""Sessions are listed, verified and taken up again from the window."""

from pathlib import Path

import pytest
from pytestqt.qtbot import QtBot

from drivers.registry import open_devices
from gui.sessions_tab import SessionsTab
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
def tab(folder: Path, qtbot: QtBot) -> SessionsTab:
    tab = SessionsTab()
    qtbot.addWidget(tab)
    tab.folder_edit.setText(str(folder))
    tab.look()
    qtbot.waitUntil(lambda: tab.table.rowCount() == 2, timeout=20_000)
    qtbot.waitUntil(tab.look_button.isEnabled)
    return tab


def states(tab: SessionsTab) -> dict[str, str]:
    cells = [[tab.table.item(row, column).text() for column in range(3)] for row in range(tab.table.rowCount())]
    return {Path(path).name: state for state, _, path in cells}


def select(tab: SessionsTab, name: str) -> None:
    names = [Path(tab.table.item(row, 2).text()).name for row in range(tab.table.rowCount())]
    tab.table.selectRow(names.index(name))


def test_each_file_is_listed_with_its_state(tab: SessionsTab):
    assert states(tab) == {"whole.h5": "complete", "damaged.h5": "damaged"}


def test_nothing_can_be_done_with_nothing(tab: SessionsTab):
    assert not tab.verify_button.isEnabled()
    select(tab, "whole.h5")
    assert tab.verify_button.isEnabled()


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
