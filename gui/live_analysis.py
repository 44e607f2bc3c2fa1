"""Looks at live frames in a thread of its own, always at the newest one."""

from __future__ import annotations

from threading import Condition

from PySide6.QtCore import QObject, QThread, Signal

from drivers.camera import CameraDescription, Frame
from gui.live_facts import live_facts


class LiveAnalysis(QThread):
    """Takes frames as fast as they come, and leaves out those that it has no time for; see `live_facts`."""

    looked = Signal(object, object)  # Frame, LiveFacts

    def __init__(self, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._newest: tuple[Frame, CameraDescription] | None = None
        self._ended = False
        self._changed = Condition()

    def look(self, frame: Frame, camera: CameraDescription) -> None:
        """Look at a frame as soon as the one before is done with."""
        with self._changed:
            self._newest = frame, camera
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
        """Look at frames until `close`; Qt calls this in the new thread."""
        while (newest := self._next()) is not None:
            frame, camera = newest
            self.looked.emit(frame, live_facts(frame.counts, camera))

    def _next(self) -> tuple[Frame, CameraDescription] | None:
        with self._changed:
            self._changed.wait_for(lambda: self._ended or self._newest is not None)
            newest, self._newest = self._newest, None
            return None if self._ended else newest
