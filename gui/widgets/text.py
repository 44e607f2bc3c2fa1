"""Texts that the operator can select and copy."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel


def selectable(text: str = "", name: str = "") -> QLabel:
    """Return a label of plain text that wraps, to be selected by mouse or keyboard.

    Parameters
    ----------
    text : str, optional
        What it shows at first.
    name : str, optional
        What a screen reader calls it.
    """
    label = QLabel(text, wordWrap=True)
    label.setTextFormat(Qt.TextFormat.PlainText)
    label.setTextInteractionFlags(
        Qt.TextInteractionFlag.TextSelectableByMouse | Qt.TextInteractionFlag.TextSelectableByKeyboard
    )
    label.setAccessibleName(name)
    return label


def QT_TRANSLATE_NOOP(context: str, text: str) -> str:
    """Mark a text for Qt's `lupdate`, which knows this name, and return it; PySide's own returns an object."""
    return text
