"""Whether the window's thread was ever blocked: a heartbeat, and the longest time without one."""

from __future__ import annotations

import time

from PySide6.QtCore import QObject, Qt, QTimer

_BEAT_MS = 5


class Watchdog(QObject):
    """Beats in the thread that it was made in, and keeps how late it was.

    Parameters
    ----------
    parent : QObject, optional
        As in Qt.
    """

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._delays: list[float] = []
        self._last = time.perf_counter()
        self._timer = QTimer(self, interval=_BEAT_MS)
        self._timer.setTimerType(Qt.TimerType.PreciseTimer)
        self._timer.timeout.connect(self._beat)

    @property
    def delays(self) -> list[float]:
        """Seconds between one beat and the next beyond what they should be, in order."""
        return list(self._delays)

    @property
    def longest(self) -> float:
        """The longest time, in seconds, for which the thread did something else than listen."""
        return max(self._delays, default=0.0)

    def begin(self) -> None:
        """Forget what was, and beat from now on."""
        self._delays.clear()
        self._last = time.perf_counter()
        self._timer.start()

    def end(self) -> None:
        """Beat no more."""
        self._timer.stop()

    def _beat(self) -> None:
        now = time.perf_counter()
        self._delays.append(max(0.0, now - self._last - _BEAT_MS / 1e3))
        self._last = now
