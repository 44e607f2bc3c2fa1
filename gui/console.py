"""The program around the window: language, theme, what is remembered, and an end in order at Ctrl-C."""

from __future__ import annotations

import logging
import signal
import sys
import xml.etree.ElementTree as ET

from PySide6.QtCore import QLocale, QTimer
from PySide6.QtWidgets import QApplication

from drivers.registry import open_devices
from gui.main_window import MainWindow
from gui.widgets.remembered import Remembered
from gui.widgets.translation import FOLDER, SourceTranslator, read_translation
from instrument.config.rig import RigConfig
from instrument.rig.rig import OpenDevices

_log = logging.getLogger(__name__)


def run(config: RigConfig, devices: OpenDevices = open_devices) -> int:
    """Show the window until it is closed, also by Ctrl-C; return Qt's exit code."""
    application = QApplication(sys.argv[:1])
    _translate(application)
    window = MainWindow(config, devices)
    remember(window, Remembered())
    window.show()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: window.close())
    # Python sees to signals only while it runs, which it does not by itself inside Qt's loop.
    heartbeat = QTimer(interval=200)
    heartbeat.timeout.connect(lambda: None)
    heartbeat.start()
    return application.exec()


def remember(window: MainWindow, remembered: Remembered) -> None:
    """Give the window what it had when it was closed, and keep that when it is closed again."""
    edits = {
        "protocol": window.protocol_panel.protocol_edit,
        "session": window.protocol_panel.session_edit,
        "folder": window.sessions_tab.folder_edit,
    }
    layouts = {"columns": window.columns, "rows": window.rows}

    def keep() -> None:
        for name, edit in edits.items():
            remembered.keep(name, edit.text())
        for name, splitter in layouts.items():
            remembered.keep(name, splitter.saveState())
        remembered.keep("window", window.saveGeometry())
        remembered.write()

    window.menus.choose_theme(remembered.theme())
    for name, edit in edits.items():
        edit.setText(remembered.text(name, edit.text()))
    for name, splitter in layouts.items():
        splitter.restoreState(remembered.layout(name))
    # One that was on a screen that is gone comes back on one that is there: Qt sees to that.
    window.restoreGeometry(remembered.layout("window"))
    window.menus.theme_chosen.connect(lambda theme: remembered.keep("theme", theme.name))
    window.closed.connect(keep)


def _translate(application: QApplication) -> None:
    """Speak the desktop's language where there is a translation; a damaged one never keeps the window from opening."""
    for language in QLocale().uiLanguages():
        path = FOLDER / f"{language.replace('-', '_')}.ts"
        if path.is_file():
            try:
                application.installTranslator(SourceTranslator(read_translation(path), application))
            except (OSError, ET.ParseError) as error:
                _log.warning("the translation %s cannot be read: %s", path.name, error)
            return
