"""Dark and light: the colours of the window, chosen by the operator or taken from the desktop."""

from __future__ import annotations

from enum import Enum

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QPalette
from PySide6.QtWidgets import QApplication

from gui.widgets.text import QT_TRANSLATE_NOOP

Role = QPalette.ColorRole


class Theme(Enum):
    """The value is what the operator reads."""

    SYSTEM = QT_TRANSLATE_NOOP("Theme", "As the &desktop")
    LIGHT = QT_TRANSLATE_NOOP("Theme", "&Light")
    DARK = QT_TRANSLATE_NOOP("Theme", "D&ark")


# A dark one for a dark laboratory: nothing in it is brighter than it has to be.
_DARK = {
    Role.Window: "#1e2226",
    Role.WindowText: "#d7dde2",
    Role.Base: "#14171a",
    Role.AlternateBase: "#1e2226",
    Role.Text: "#d7dde2",
    Role.PlaceholderText: "#8b959e",
    Role.Button: "#2d3339",
    Role.ButtonText: "#d7dde2",
    Role.ToolTipBase: "#2d3339",
    Role.ToolTipText: "#d7dde2",
    Role.BrightText: "#ffffff",
    Role.Link: "#56b4e9",
    Role.Highlight: "#0072b2",
    Role.HighlightedText: "#ffffff",
    Role.Light: "#3a4148",
    Role.Midlight: "#33393f",
    Role.Mid: "#262b30",
    Role.Dark: "#101215",
    Role.Shadow: "#000000",
}

_LIGHT = {
    Role.Window: "#eff1f3",
    Role.WindowText: "#1b1f23",
    Role.Base: "#ffffff",
    Role.AlternateBase: "#f4f6f8",
    Role.Text: "#1b1f23",
    Role.PlaceholderText: "#66707a",
    Role.Button: "#e1e5e8",
    Role.ButtonText: "#1b1f23",
    Role.ToolTipBase: "#ffffff",
    Role.ToolTipText: "#1b1f23",
    Role.BrightText: "#000000",
    Role.Link: "#0072b2",
    Role.Highlight: "#0072b2",
    Role.HighlightedText: "#ffffff",
    Role.Light: "#ffffff",
    Role.Midlight: "#f4f6f8",
    Role.Mid: "#c3c9ce",
    Role.Dark: "#a0a8af",
    Role.Shadow: "#70777d",
}

_DISABLED = {Theme.DARK: "#6b747c", Theme.LIGHT: "#8d959c"}


def apply_theme(application: QApplication, theme: Theme) -> None:
    """Give all windows the colours of a theme."""
    # One style on every desktop: it takes all its colours from the palette. To set it again takes its time.
    if application.style().objectName() != "fusion":
        application.setStyle("Fusion")
    application.setPalette(palette_of(_resolved(application, theme)))


def palette_of(theme: Theme) -> QPalette:
    """Return the colours of `LIGHT` or `DARK`."""
    palette = QPalette()
    for role, colour in (_DARK if theme is Theme.DARK else _LIGHT).items():
        palette.setColor(role, QColor(colour))
    for role in (Role.WindowText, Role.Text, Role.ButtonText):
        palette.setColor(QPalette.ColorGroup.Disabled, role, QColor(_DISABLED[theme]))
    return palette


def _resolved(application: QApplication, theme: Theme) -> Theme:
    if theme is not Theme.SYSTEM:
        return theme
    is_dark = application.styleHints().colorScheme() == Qt.ColorScheme.Dark
    return Theme.DARK if is_dark else Theme.LIGHT
