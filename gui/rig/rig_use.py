"""Who has the rig: the live picture, or a job. One at a time, handed over without blocking the window."""

from __future__ import annotations

from PySide6.QtCore import QObject, QTimer, Signal

from gui.rig.acquisition import Acquisition
from gui.widgets.job import Job, Work

_PATIENCE_MS = 50  # from one request to leave the rig to the next: one that falls before an exposure is not heard


class RigUse(QObject):
    """Lets a job have the rig that the live picture holds, and gives it back afterwards.

    Parameters
    ----------
    acquisition : Acquisition
    """

    job_began = Signal(object)  # Job: what it tells can be listened to from now on
    job_ended = Signal()

    def __init__(self, acquisition: Acquisition) -> None:
        super().__init__(acquisition)
        self._acquisition = acquisition
        self._waiting: Work | None = None
        self._job: Job | None = None
        self._leaving = QTimer(self, interval=_PATIENCE_MS)
        self._leaving.timeout.connect(acquisition.ask_to_leave)
        acquisition.finished.connect(self._begin)

    @property
    def job(self) -> Job | None:
        """The job that has the rig; None if there is none."""
        return self._job

    @property
    def is_busy(self) -> bool:
        """Whether a job has the rig, or waits for it."""
        return self._waiting is not None or self._job is not None

    def begin(self, work: Work) -> None:
        """Begin `work` as soon as the live picture has left the rig; nothing if a job has it."""
        if self.is_busy:
            return
        self._waiting = work
        if self._acquisition.isRunning():
            self._acquisition.ask_to_leave()
            self._leaving.start()
        else:
            self._begin()

    def pause(self) -> None:
        """Ask the job to stop after the pose that is being taken."""
        if self._job is not None:
            self._job.pause()

    def abort(self) -> None:
        """End the job at once, with the light off; one that waits for the rig is not begun."""
        if self._job is not None:
            self._job.abort()
        elif self._waiting is not None:
            self._waiting = None
            self._leaving.stop()
            self.job_ended.emit()

    def close(self) -> None:
        """End the job with the light off, join its thread, and give the rig to nobody any more."""
        self._waiting = None
        self._leaving.stop()
        if self._job is not None:
            self._job.finished.disconnect(self._end)
            self._job.abort()
            self._job.wait()
            self._job = None

    def _begin(self) -> None:
        self._leaving.stop()
        work, self._waiting = self._waiting, None
        if work is None:
            return
        self._job = Job(work, self)
        self._job.finished.connect(self._end)
        self.job_began.emit(self._job)
        self._job.start()

    def _end(self) -> None:
        self._job = None
        self.job_ended.emit()
        self._acquisition.start()
