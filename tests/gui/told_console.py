"""`halfangle console` in a process of its own, which tells where its widgets are and what they show.

`python -m tests.gui.told_console FOLDER console --rig RIG ...`: every 50 ms it writes FOLDER/told.json, and clicks the
button or writes into the field that FOLDER/orders names. Nothing of the window is replaced.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from PySide6.QtCore import QPoint, QTimer
from PySide6.QtGui import QCloseEvent
from PySide6.QtWidgets import QWidget

from cli.main import main
from gui import console
from gui.main_window import MainWindow
from gui.widgets.actions import ActionButton

ROOT = Path(__file__).parents[2]
_PERIOD_MS = 50


class ToldWindow(MainWindow):
    """Tells, and obeys."""

    folder: Path

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        self._timer = QTimer(self, interval=_PERIOD_MS)
        self._timer.timeout.connect(self._tell)
        self._timer.timeout.connect(self._obey)
        self._timer.start()

    def closeEvent(self, event: QCloseEvent) -> None:
        self._timer.stop()
        super().closeEvent(event)

    def _tell(self) -> None:
        buttons = {button.objectName(): button for button in self.findChildren(ActionButton)}
        edits = {"protocol": self.protocol_panel.protocol_edit, "session": self.protocol_panel.session_edit}
        told = {
            "light": self.light_label.text(),
            "state": self.protocol_panel.state_label.text(),
            "banner": self.banner.text(),
            "frames": self.live_view.facts_label.text(),
            "where": {name: _centre(widget) for name, widget in (buttons | edits).items()},
            "enabled": [name for name, button in buttons.items() if button.isEnabled()],
        }
        new = self.folder / "told.new"
        new.write_text(json.dumps(told))
        new.replace(self.folder / "told.json")

    def _obey(self) -> None:
        orders = self.folder / "orders"
        if not orders.exists():
            return
        key, _, text = orders.read_text().partition(" ")
        orders.unlink()
        edits = {"protocol": self.protocol_panel.protocol_edit, "session": self.protocol_panel.session_edit}
        if key in edits:
            edits[key].setText(text)
        for button in self.findChildren(ActionButton):
            if button.objectName() == key:
                button.click()


class ToldConsole:
    """The process, seen from the test.

    Parameters
    ----------
    folder : Path
    words : list of str
        After `halfangle`.
    environment : dict, optional
        Besides that of the test.
    """

    def __init__(self, folder: Path, words: list[str], environment: dict[str, str] | None = None) -> None:
        self._folder = folder
        # The user's own settings stay as they are.
        settings = {"XDG_CONFIG_HOME": str(folder / "settings"), "PYTHONPATH": str(ROOT)}
        self.process = subprocess.Popen(
            [sys.executable, "-m", "tests.gui.told_console", str(folder), *words],
            env=os.environ | settings | (environment or {}),
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )

    def told(self) -> dict[str, Any]:
        """Return what it told last; nothing before it has."""
        path = self._folder / "told.json"
        return dict(json.loads(path.read_text())) if path.exists() else {}

    def wait_until(self, holds: Callable[[dict[str, Any]], bool], timeout: float = 60.0) -> dict[str, Any]:
        """Wait for what it tells."""
        end = time.monotonic() + timeout
        while time.monotonic() < end:
            told = self.told()
            if told and holds(told):
                return told
            if self.process.poll() is not None:
                raise AssertionError(f"the console ended: {self.process.communicate()[1]}")
            time.sleep(0.02)
        raise AssertionError(f"it never came; the last was {self.told()}")

    def place_of(self, name: str) -> tuple[int, int]:
        """Return where a widget is on the screen, once it stays there: texts that come make room for themselves."""
        before, now = None, self.told()["where"][name]
        while before != now:
            time.sleep(6e-3 * _PERIOD_MS)
            before, now = now, self.told()["where"][name]
        return now[0], now[1]

    def order(self, key: str) -> None:
        """Let it click a button, once that is enabled."""
        self.wait_until(lambda told: key in told["enabled"])
        self._send(key)

    def write(self, field: str, text: str) -> None:
        """Let it write into a field, ``"protocol"`` or ``"session"``."""
        self._send(f"{field} {text}")

    def _send(self, order: str) -> None:
        self.wait_until(lambda _: not (self._folder / "orders").exists())
        (self._folder / "orders.new").write_text(order)
        (self._folder / "orders.new").replace(self._folder / "orders")


def _centre(widget: QWidget) -> tuple[int, int]:
    place = widget.mapToGlobal(QPoint(widget.width() // 2, widget.height() // 2))
    return place.x(), place.y()


if __name__ == "__main__":
    ToldWindow.folder = Path(sys.argv[1])
    console.MainWindow = ToldWindow  # type: ignore[misc]
    main(sys.argv[2:])
