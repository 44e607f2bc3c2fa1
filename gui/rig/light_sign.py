"""Whether the light shines, to be read from two metres."""

from __future__ import annotations

from enum import Enum

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QWidget

from gui.widgets.text import QT_TRANSLATE_NOOP
from protocols.capture.progress import State


class LightSign(Enum):
    """What is known of the light."""

    OFF = QT_TRANSLATE_NOOP("LightLabel", "LIGHT OFF")
    ON = QT_TRANSLATE_NOOP("LightLabel", "LIGHT ON")
    UNKNOWN = QT_TRANSLATE_NOOP("LightLabel", "LIGHT UNKNOWN")


# The same in the dark and in the light theme: what it means must not depend on it.
_STYLES = {
    LightSign.OFF: "background: #20262c; color: #a8bccb",
    LightSign.ON: "background: #ffb000; color: black",
    LightSign.UNKNOWN: "background: #d000b0; color: white",
}

# A capture switches the light on and off for each pose: while it runs, the light may shine at any moment.
SIGNS = {state: LightSign.ON if state in (State.RUNNING, State.WARMUP) else LightSign.OFF for state in State} | {
    State.PREFLIGHT: LightSign.UNKNOWN,
    State.FINISHING: LightSign.UNKNOWN,
    State.NOT_SAFE: LightSign.UNKNOWN,
}


class LightLabel(QLabel):
    """Shows one sign, in a colour of its own."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAlignment(Qt.AlignmentFlag.AlignCenter)
        self.setTextInteractionFlags(
            Qt.TextInteractionFlag.TextSelectableByMouse | Qt.TextInteractionFlag.TextSelectableByKeyboard
        )
        self.show_sign(LightSign.UNKNOWN)

    def show_sign(self, sign: LightSign) -> None:
        """Show what is known of the light."""
        self.setText(self.tr(sign.value))
        self.setStyleSheet(f"{_STYLES[sign]}; font: bold 16pt; padding: 8px; border: 2px solid #808080")
