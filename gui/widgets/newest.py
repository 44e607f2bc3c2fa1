"""Work in a thread of its own, always on the newest that was asked for."""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Condition
from typing import Any

from PySide6.QtCore import QObject, QThread, Signal


class Newest(QThread):
    """Does work as fast as it is asked for, and leaves out what it has no time for.

    Parameters
    ----------
    work : callable
        Takes what was asked for; what it returns comes with `done`.
    rest : float, optional
        It rests after its work for so many times as long as that took, to leave the cores to others.
    parent : QObject, optional
        As in Qt.
    """

    done = Signal(object)

    failed = Signal(str)  # why there is nothing to be `done`

    def __init__(self, work: Callable[[Any], object], parent: QObject | None = None, rest: float = 0.0) -> None:
        super().__init__(parent)
        self._work, self._rest = work, rest
        # A list of one, since anything may be asked for, None included.
        self._newest: list[Any] = []
        self._ended = False
        self._changed = Condition()

    def ask(self, what: Any) -> None:
        """Do the work on `what` as soon as the work under way is done."""
        with self._changed:
            self._newest = [what]
            self._changed.notify()
        if not self.isRunning():
            self.start()

    def close(self) -> None:
        """Join the thread."""
        with self._changed:
            self._ended = True
            self._changed.notify()
        self.wait()

    def run(self) -> None:
        """Work until `close`; Qt calls this in the new thread."""
        while newest := self._next():
            began = time.monotonic()
            try:
                self.done.emit(self._work(newest[0]))
            # A thread that ended by an error would be missed by nobody.
            except Exception as error:
                self.failed.emit(str(error))
            self._sleep(self._rest * (time.monotonic() - began))

    def _sleep(self, seconds: float) -> None:
        with self._changed:
            self._changed.wait_for(lambda: self._ended, seconds)

    def _next(self) -> list[Any]:
        with self._changed:
            self._changed.wait_for(lambda: self._ended or bool(self._newest))
            newest, self._newest = self._newest, []
            return [] if self._ended else newest
