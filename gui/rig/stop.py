"""STOP: a button that cannot be missed, and Esc pressed twice, wherever the keyboard's focus is."""

from __future__ import annotations

import time

from PySide6.QtCore import QCoreApplication, QEvent, QObject, Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QSizePolicy, QWidget

from gui.widgets.actions import ActionButton

SECOND_PRESS_S = 1.0
"""Esc closes lists and dialogs too, so that one alone must not end a capture of an hour."""


class StopButton(ActionButton):
    """Is always enabled, and the largest of the window."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__("rig.stop", parent)
        self.setStyleSheet("background: #c00000; color: white; font: bold 16pt; padding: 14px")
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Fixed)


class EscapeTwice(QObject):
    """Hears Esc in every window of the program, also while a list or a dialog is open."""

    pressed_once = Signal()
    pressed_twice = Signal()

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._last = -SECOND_PRESS_S
        application = QCoreApplication.instance()
        if application is not None:
            application.installEventFilter(self)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Count presses of Esc and hide none from anybody; Qt calls this for each event of the program."""
        # A press comes to a window of the desktop first, be it a list's; only then to widgets, one after the other.
        if event.type() == QEvent.Type.KeyPress and watched.isWindowType() and isinstance(event, QKeyEvent):
            self._press(event)
        return False

    def _press(self, event: QKeyEvent) -> None:
        if event.key() != Qt.Key.Key_Escape or event.isAutoRepeat():
            return
        now = time.monotonic()
        if now - self._last <= SECOND_PRESS_S:
            self._last = -SECOND_PRESS_S
            self.pressed_twice.emit()
        else:
            self._last = now
            self.pressed_once.emit()
