"""What the window had is there again; what it remembers never keeps it from opening."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from PySide6.QtCore import QSettings
from pytestqt.qtbot import QtBot

from gui.console import remember
from gui.main_window import MainWindow
from gui.widgets.remembered import Remembered
from gui.widgets.theme import Theme
from tests.gui.test_main_window import Bench, rig_config


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "console.ini"


def memory(file: Path) -> Remembered:
    return Remembered(QSettings(str(file), QSettings.Format.IniFormat))


@pytest.fixture
def window(qtbot: QtBot) -> Iterator[MainWindow]:
    window = MainWindow(rig_config(), Bench().devices)
    yield window
    window.close()
    window.deleteLater()


def test_a_window_opens_with_what_the_last_one_had(file: Path, window: MainWindow, qtbot: QtBot):
    remember(window, memory(file))
    window.resize(777, 555)
    window.show()
    window.protocol_panel.protocol_edit.setText("sweep.toml")
    window.menus.choose_theme(Theme.DARK)
    window.columns.setSizes([200, 377, 200])
    sizes = window.columns.sizes()
    window.close()
    other = MainWindow(rig_config(), Bench().devices)
    remember(other, memory(file))
    other.show()
    assert other.protocol_panel.protocol_edit.text() == "sweep.toml"
    assert other.menus.theme is Theme.DARK
    assert (other.width(), other.height()) == (777, 555)
    assert other.columns.sizes() == pytest.approx(sizes, abs=2)
    other.close()
    other.deleteLater()


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x00\xff\xfe not ini \x80",
        b"[General]\ntheme=PINK\nprotocol=@Variant(\\0\\0\\0\\x7f)\nwindow=@ByteArray(\\x1)\n",
        b"[General]\ntheme=7\nprotocol=1, 2, 3\nsession=@Invalid()\ncolumns=abc\nwindow=12\n",
        b"[General\ntheme",
    ],
)
def test_a_damaged_memory_never_keeps_the_window_from_opening(file: Path, window: MainWindow, content: bytes):
    file.write_bytes(content)
    remember(window, memory(file))
    window.show()
    assert window.isVisible()
    assert window.width() > 100
    assert window.menus.theme is Theme.SYSTEM


def test_a_memory_that_cannot_be_written_is_a_line_in_the_log(
    tmp_path: Path, window: MainWindow, caplog: pytest.LogCaptureFixture
):
    (tmp_path / "file").write_text("no folder")
    remember(window, memory(tmp_path / "file" / "console.ini"))
    window.show()
    window.close()
    assert "cannot be written" in caplog.text


def test_the_file_that_a_program_of_the_operator_reads_says_what_is_meant(file: Path, window: MainWindow):
    remember(window, memory(file))
    window.protocol_panel.session_edit.setText("relief.h5")
    window.close()
    assert "session=relief.h5" in file.read_text()
