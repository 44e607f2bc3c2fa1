"""What the window remembers from one time to the next; a file of it that is damaged costs a line in the log."""

from __future__ import annotations

import logging
from contextlib import suppress
from typing import Any

from PySide6.QtCore import QByteArray, QSettings

from gui.widgets.theme import Theme

_log = logging.getLogger(__name__)


class Remembered:
    """Values by name in the user's settings; whatever is missing or of the wrong kind is its default.

    Parameters
    ----------
    settings : QSettings, optional
        By default the user's own file.
    """

    def __init__(self, settings: QSettings | None = None) -> None:
        self._settings = settings or QSettings(
            QSettings.Format.IniFormat, QSettings.Scope.UserScope, "halfangle", "console"
        )
        if self._settings.status() is not QSettings.Status.NoError:
            _log.warning("the settings in %s cannot be read; the window opens with its own", self._settings.fileName())

    def text(self, name: str, default: str = "") -> str:
        """Return a text."""
        value = self._value(name)
        return value if isinstance(value, str) else default

    def layout(self, name: str) -> QByteArray:
        """Return a layout as a widget saved it; empty if there is none."""
        value = self._value(name)
        return value if isinstance(value, QByteArray) else QByteArray()

    def theme(self) -> Theme:
        """Return the theme that was chosen."""
        name = self.text("theme")
        return Theme[name] if name in Theme.__members__ else Theme.SYSTEM

    def keep(self, name: str, value: str | QByteArray) -> None:
        """Remember a value; one that cannot be written is forgotten, with a line in the log."""
        self._settings.setValue(name, value)

    def write(self) -> None:
        """Write everything to the disk."""
        self._settings.sync()
        if self._settings.status() is not QSettings.Status.NoError:
            _log.warning("the settings cannot be written to %s", self._settings.fileName())

    def _value(self, name: str) -> Any:
        # A value of a kind that this Qt does not know raises.
        with suppress(Exception):
            return self._settings.value(name)
        return None
