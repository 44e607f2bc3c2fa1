"""Writes poses while the next one is taken, in order and with bounded memory."""

from __future__ import annotations

import time
from collections.abc import Callable
from queue import Empty, Full, Queue
from threading import Thread

from drivers.clock import LONGEST_NAP
from instrument.recording.recorder import Recorder
from instrument.session.audit import AuditLog
from instrument.session.records import PoseRecord

DEPTH = 2
"""Poses that may wait for the disk; each holds a whole bracket."""

DISK_LIMIT = 300.0
"""Seconds that the disk may take for one pose before it counts as stalled."""


class DiskStalledError(OSError):
    """The disk took nothing for too long."""


class PoseWriter:
    """A thread that hands poses to the recorder; the first error ends it, and is raised to whoever asks next.

    Parameters
    ----------
    recorder : Recorder
    audit : AuditLog
        Its lines go into the session with each pose.
    """

    def __init__(self, recorder: Recorder, audit: AuditLog) -> None:
        self._recorder, self._audit = recorder, audit
        self._queue: Queue[tuple[int, PoseRecord] | None] = Queue(DEPTH)
        self._error: BaseException | None = None
        self._n_written = 0
        self._thread = Thread(target=self._run, name="pose writer", daemon=True)
        self._thread.start()

    @property
    def n_written(self) -> int:
        """Poses that are on the disk, whole."""
        return self._n_written

    def put(self, i_pose: int, record: PoseRecord, waiting: Callable[[], None]) -> None:
        """Hand over a pose; where too many wait already, wait for the disk.

        Parameters
        ----------
        i_pose : int
        record : PoseRecord
        waiting : callable
            Called now and then while waiting; what it raises ends the wait.

        Raises
        ------
        OSError
            If an earlier pose could not be written, or the disk stalls.
        """
        self._patiently(lambda: self._queue.put((i_pose, record), timeout=LONGEST_NAP), Full, waiting)

    def finish(self) -> None:
        """Wait until everything is written, and end the thread.

        Raises
        ------
        OSError
            If a pose could not be written, or the disk stalls.
        """
        self._patiently(lambda: self._queue.put(None, timeout=LONGEST_NAP), Full, lambda: None)
        self._patiently(self._join, Empty, lambda: None)
        self._raise_error()

    def _join(self) -> None:
        self._thread.join(LONGEST_NAP)
        if self._thread.is_alive():
            raise Empty

    def _patiently(self, step: Callable[[], None], not_yet: type[Exception], waiting: Callable[[], None]) -> None:
        deadline, seen = time.monotonic() + DISK_LIMIT, self._n_written
        while True:
            self._raise_error()
            try:
                step()
            except not_yet:
                waiting()
            else:
                return
            if self._n_written != seen:
                deadline, seen = time.monotonic() + DISK_LIMIT, self._n_written
            if time.monotonic() > deadline:
                raise DiskStalledError(f"the disk has taken no pose for {DISK_LIMIT:g} s. Look after it, then go on")

    def _raise_error(self) -> None:
        if self._error is not None:
            raise self._error

    def _run(self) -> None:
        try:
            while (item := self._queue.get()) is not None:
                self._recorder.write_pose(*item, self._audit.take())
                self._n_written += 1
        except BaseException as error:
            self._error = error
