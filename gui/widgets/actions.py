"""What the operator can do, as data: each with the command that does the same without a window."""

from __future__ import annotations

from dataclasses import dataclass

from PySide6.QtCore import QCoreApplication, QEvent
from PySide6.QtGui import QAction, QKeySequence
from PySide6.QtWidgets import QPushButton, QWidget

from gui.widgets.text import QT_TRANSLATE_NOOP

CONTEXT = "Actions"


@dataclass(frozen=True, slots=True)
class ActionInfo:
    """One thing to do.

    Attributes
    ----------
    key : str
        Names it, ``"menu.verb"``.
    text : str
        On its button; with the letter to press with Alt where it has no shortcut.
    command : str
        The command line that does the same.
    shortcut : str
        Keys that do it from anywhere in the window; empty if there are none.
    """

    key: str
    text: str
    command: str
    shortcut: str = ""

    @property
    def menu(self) -> str:
        """The menu it stands in."""
        return self.key.partition(".")[0]


MENUS = {
    "rig": QT_TRANSLATE_NOOP("Actions", "&Rig"),
    "capture": QT_TRANSLATE_NOOP("Actions", "&Capture"),
    "sessions": QT_TRANSLATE_NOOP("Actions", "S&essions"),
}

ACTIONS = {
    action.key: action
    for action in (
        ActionInfo("rig.stop", QT_TRANSLATE_NOOP("Actions", "STOP (Esc Esc)"), "halfangle rig safe RIG"),
        ActionInfo("rig.connect", QT_TRANSLATE_NOOP("Actions", "Connect"), "halfangle rig check RIG", "Ctrl+K"),
        ActionInfo("rig.live", QT_TRANSLATE_NOOP("Actions", "Live (light on)"), "halfangle rig frame RIG", "Ctrl+L"),
        ActionInfo(
            "capture.plan",
            QT_TRANSLATE_NOOP("Actions", "Check and estimate"),
            "halfangle plan PROTOCOL --rig RIG",
            "F6",
        ),
        ActionInfo(
            "capture.start",
            QT_TRANSLATE_NOOP("Actions", "Start"),
            "halfangle capture PROTOCOL --rig RIG -o SESSION",
            "F5",
        ),
        ActionInfo(
            "capture.pause",
            QT_TRANSLATE_NOOP("Actions", "Pause after this pose"),
            "halfangle capture: Ctrl-C once",
            "F8",
        ),
        ActionInfo(
            "capture.resume", QT_TRANSLATE_NOOP("Actions", "Resume the session"), "halfangle resume SESSION", "F9"
        ),
        ActionInfo(
            "capture.abort",
            QT_TRANSLATE_NOOP("Actions", "Abort now"),
            "halfangle capture: Ctrl-C twice",
            "Ctrl+F8",
        ),
        ActionInfo("sessions.look", QT_TRANSLATE_NOOP("Actions", "L&ook"), "halfangle session list FOLDER"),
        ActionInfo("sessions.verify", QT_TRANSLATE_NOOP("Actions", "Verif&y"), "halfangle session verify SESSION"),
        ActionInfo(
            "sessions.calibrate",
            QT_TRANSLATE_NOOP("Actions", "Cali&brate"),
            "halfangle calibrate SESSION -o STACK --report PAGE --json FIGURES",
        ),
        ActionInfo(
            "sessions.reconstruct",
            QT_TRANSLATE_NOOP("Actions", "Reconstr&uct"),
            "halfangle reconstruct SOURCE -o RESULT",
        ),
        ActionInfo(
            "sessions.report", QT_TRANSLATE_NOOP("Actions", "&Make a report"), "halfangle report RESULT -o PAGE"
        ),
    )
}

GESTURES = {
    "choose an exposure time": "halfangle rig frame RIG --exposure-time SECONDS",
    "mark a region of the live picture": "halfangle rig frame RIG --region TOP LEFT BOTTOM RIGHT",
    "look at a capture while it runs": "halfangle session quick-look SESSION",
    "pick a point of a result": "halfangle point RESULT ROW COLUMN",
    "drag the light over a result": "halfangle render RESULT --camera X,Y,Z --light X,Y,Z -o PICTURE",
}
"""What is done without a button, each with its command as well."""


class ActionButton(QPushButton):
    """A button that does one action; `menu_action` stands for it in a menu and has its shortcut.

    Parameters
    ----------
    key : str
        Of `ACTIONS`.
    parent : QWidget, optional
        As in Qt.
    """

    def __init__(self, key: str, parent: QWidget | None = None) -> None:
        self.info = ACTIONS[key]
        text = QCoreApplication.translate(CONTEXT, self.info.text)
        super().__init__(text, parent)
        self.setObjectName(key)
        self.setToolTip(self.info.command)
        self.menu_action = QAction(text, self)
        self.menu_action.setShortcut(QKeySequence(self.info.shortcut))
        self.menu_action.triggered.connect(self.click)

    def changeEvent(self, event: QEvent) -> None:
        """Let the menu offer what the button offers; Qt calls this."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.EnabledChange:
            self.menu_action.setEnabled(self.isEnabled())
