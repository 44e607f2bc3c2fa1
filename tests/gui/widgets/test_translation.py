"""The operator's language comes from files that translators edit."""

import shutil
import subprocess
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from PySide6.QtWidgets import QApplication
from pytestqt.qtbot import QtBot

from gui import console
from gui.rig.light_sign import LightLabel, LightSign
from gui.widgets.translation import SourceTranslator, read_translation

ROOT = Path(__file__).parents[3]
TRANSLATION = """<?xml version="1.0" encoding="utf-8"?>
<!DOCTYPE TS>
<TS version="2.1" language="de">
<context>
    <name>LightLabel</name>
    <message><source>LIGHT ON</source><translation>LICHT AN</translation></message>
    <message><source>LIGHT OFF</source><translation type="unfinished">LICHT</translation></message>
</context>
</TS>
"""


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "de.ts"
    path.write_text(TRANSLATION, encoding="utf-8")
    return path


def test_finished_texts_are_in_the_other_language_and_others_stay(file: Path, qtbot: QtBot, qapp: QApplication):
    translator = SourceTranslator(read_translation(file), qapp)
    qapp.installTranslator(translator)
    try:
        label = LightLabel()
        qtbot.addWidget(label)
        label.show_sign(LightSign.ON)
        assert label.text() == "LICHT AN"
        label.show_sign(LightSign.OFF)
        assert label.text() == "LIGHT OFF"
    finally:
        qapp.removeTranslator(translator)


def test_a_damaged_translation_is_a_line_in_the_log_and_the_window_speaks_english(
    tmp_path: Path, qapp: QApplication, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
):
    for name in ("en.ts", "en_US.ts", "C.ts", "en_Latn_US.ts"):
        (tmp_path / name).write_text("<TS><context>", encoding="utf-8")
    monkeypatch.setattr(console, "FOLDER", tmp_path)
    console._translate(qapp)
    assert "cannot be read" in caplog.text


@pytest.mark.skipif(shutil.which("pyside6-lupdate", path=str(ROOT / ".venv" / "bin")) is None, reason="no lupdate")
def test_the_translators_tool_finds_the_texts(tmp_path: Path):
    tool = ROOT / ".venv" / "bin" / "pyside6-lupdate"
    sources = [str(path) for path in sorted((ROOT / "gui").rglob("*.py"))]
    subprocess.run([str(tool), *sources, "-ts", str(tmp_path / "xx.ts")], check=True, capture_output=True, timeout=60)
    found = {
        (context.findtext("name"), message.findtext("source"))
        for context in ET.parse(tmp_path / "xx.ts").getroot().iter("context")
        for message in context.iter("message")
    }
    assert {("LightLabel", "LIGHT ON"), ("Actions", "Check and estimate"), ("LiveView", "B&oards")} <= found
    assert len(found) > 150
