"""What happened, line by line with its time, filtered by level."""

from __future__ import annotations

import logging
from collections import deque
from datetime import datetime

from PySide6.QtCore import QObject, Signal
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLabel, QPlainTextEdit, QVBoxLayout, QWidget

from gui.widgets.text import QT_TRANSLATE_NOOP

LEVELS = {
    logging.DEBUG: QT_TRANSLATE_NOOP("LogPanel", "All"),
    logging.INFO: QT_TRANSLATE_NOOP("LogPanel", "Information"),
    logging.WARNING: QT_TRANSLATE_NOOP("LogPanel", "Warnings"),
    logging.ERROR: QT_TRANSLATE_NOOP("LogPanel", "Errors"),
}

_MAX_LINES = 2000


class LogRelay(logging.Handler):
    """Carries what any thread logs to the window's thread."""

    class Carrier(QObject):
        """Has the signal, which a handler cannot have itself."""

        logged = Signal(int, str)  # level, text

    def __init__(self) -> None:
        super().__init__()
        self.carrier = self.Carrier()

    def emit(self, record: logging.LogRecord) -> None:
        """Send a record on; Python's logging calls this in the thread that logs."""
        self.carrier.logged.emit(record.levelno, record.getMessage())


class LogPanel(QWidget):
    """Shows the newest lines of the level that is chosen, and graver ones."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._lines: deque[tuple[int, str]] = deque(maxlen=_MAX_LINES)
        self._newest = ""
        self.level_box = QComboBox()
        for level, text in LEVELS.items():
            self.level_box.addItem(self.tr(text), level)
        self.level_box.setCurrentIndex(list(LEVELS).index(logging.INFO))
        self.level_box.currentIndexChanged.connect(self._show_all)
        self.text = QPlainTextEdit(readOnly=True, maximumBlockCount=_MAX_LINES)
        self.text.setAccessibleName(self.tr("Log"))
        # Tab goes on to the next part of the window: nobody writes in here.
        self.text.setTabChangesFocus(True)
        label = QLabel(self.tr("&Log"))
        label.setBuddy(self.level_box)
        row = QHBoxLayout()
        row.addWidget(label)
        row.addWidget(self.level_box)
        row.addStretch()
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addLayout(row)
        column.addWidget(self.text)

    def add(self, level: int, text: str) -> None:
        """Add a line with the time of now; what has just been said is not said again."""
        if text == self._newest:
            return
        self._newest = text
        line = f"{datetime.now():%H:%M:%S}  {logging.getLevelName(level):<8}  {text}"
        self._lines.append((level, line))
        if level >= self.level_box.currentData():
            self.text.appendPlainText(line)

    def _show_all(self) -> None:
        shown = self.level_box.currentData()
        self.text.setPlainText("\n".join(line for level, line in self._lines if level >= shown))
