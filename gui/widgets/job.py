"""A capture, or another thing that takes the rig for a while, in a thread of its own."""

from __future__ import annotations

from collections.abc import Callable

from PySide6.QtCore import QObject, QThread, Signal

from protocols.capture.control import Control
from protocols.capture.progress import Watcher

Work = Callable[[Watcher, Control], object]


class Job(QThread):
    """Runs once; its methods may be called from any thread.

    Parameters
    ----------
    work : callable
        Takes who is to be told of its progress, and by what it is asked to stop; returns what came of it.
    parent : QObject, optional
        As in Qt.
    """

    progressed = Signal(object)  # protocols.capture.progress.Progress
    succeeded = Signal(object)  # what `work` returned
    failed = Signal(str)  # why it ended, in words

    def __init__(self, work: Work, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._work = work
        self._control = Control()

    @property
    def stop_asked(self) -> bool:
        """Whether somebody asked it to stop."""
        return self._control.pause_asked or self._control.cancel.is_set()

    def pause(self) -> None:
        """Ask to stop after the pose that is being taken."""
        self._control.pause()

    def abort(self) -> None:
        """Ask to stop at once, with the light off."""
        self._control.abort()

    def run(self) -> None:
        """Work; Qt calls this in the new thread."""
        try:
            self.succeeded.emit(self._work(self.progressed.emit, self._control))
        # Whatever ends it has to reach the operator.
        except Exception as error:
            self.failed.emit("\n".join([str(error), *getattr(error, "__notes__", ())]))
