"""Ends a run: makes the rig safe, closes the file, and says how to go on."""

from __future__ import annotations

from pathlib import Path

from drivers.errors import CancelledError, DeviceError, DeviceLostError, DeviceTimeoutError, NotSafeError
from instrument.recording.recorder import Recorder
from instrument.rig.bounded import within
from instrument.rig.rig import Rig, not_safe
from instrument.session.audit import AuditLog
from instrument.session.layout import Status
from protocols.capture.errors import CaptureFaultError, NotSafeCaptureError, PausedError
from protocols.capture.pose_writer import PoseWriter
from protocols.capture.progress import Finish

CLOSE_LIMIT = 60.0
"""Seconds that closing the session may take; a stalled disk must not keep anybody waiting for ever."""


class Ending:
    """Ends a run, and keeps what failed on the way for the message.

    Parameters
    ----------
    rig : Rig
    recorder : Recorder
    audit : AuditLog
    writer : PoseWriter
        May still hold poses that wait for the disk.
    path : Path
        Of the session.
    n_poses, n_before : int
        How many poses the plan has, and how many were complete before the run.
    """

    def __init__(
        self, rig: Rig, recorder: Recorder, audit: AuditLog, writer: PoseWriter, path: Path, n_poses: int, n_before: int
    ) -> None:
        self._rig, self._recorder, self._audit, self._writer, self._path = rig, recorder, audit, writer, path
        self._n_poses, self._n_before = n_poses, n_before
        self._unsafe: tuple[str, ...] = ()
        self._unclosed = ""

    @property
    def n_complete(self) -> int:
        """How many poses are whole in the file."""
        return self._n_before + self._writer.n_written

    @property
    def is_unsafe(self) -> bool:
        """Whether the light or the stage could not be made safe."""
        return bool(self._unsafe)

    def complete(self) -> None:
        """End a run that took every pose.

        Raises
        ------
        DeviceError
            If the rig is not safe.
        OSError
            If the session cannot be written.
        """
        failures = self._rig.safe()
        if failures:
            raise NotSafeError(not_safe(failures))
        self._writer.finish()
        self._close(Finish.COMPLETE, Status.COMPLETE, "")

    def after(self, error: BaseException) -> Finish:
        """Make the rig safe and close the file after `error`; return how the run ended."""
        finish = _finish_of(error)
        self._unsafe = self._rig.safe()
        try:
            self._writer.finish()
        except BaseException as failure:
            if failure is not error:
                self._unclosed = f" Not all poses could be written: {failure}."
        try:
            self._close(finish, Status.ABORTED if finish is Finish.ABORTED else Status.INTERRUPTED, str(error))
        except Exception as failure:
            # Whoever closes it later must not wait for that disk, too.
            self._recorder.abandon()
            self._unclosed += f" The session could not be closed: {failure}."
        return finish

    def fault(self, error: BaseException) -> BaseException:
        """Return the error to raise, with how to go on."""
        if self._unsafe:
            return NotSafeCaptureError(self.message(str(error) or "interrupted"))
        if isinstance(error, OSError) and not isinstance(error, DeviceError):
            return OSError(error.errno, self.message(error.strerror or str(error)))
        if isinstance(error, DeviceError | CancelledError | PausedError | KeyboardInterrupt):
            return CaptureFaultError(self.message(str(error) or "interrupted"))
        error.add_note(self._how_to_go_on)
        return error

    def message(self, what: str) -> str:
        """Return `what` happened as a sentence, with how to go on."""
        return f"{what if what.endswith(('.', '?', '!')) else f'{what}.'} {self._how_to_go_on}"

    def _close(self, finish: Finish, status: Status, why: str) -> None:
        self._audit.note("finish", finish=finish.value, why=why, unsafe=list(self._unsafe))

        def close() -> None:
            self._recorder.write_events(self._audit.take())
            self._recorder.close(status)

        within(CLOSE_LIMIT, "closing the session", close)

    @property
    def _how_to_go_on(self) -> str:
        rig = not_safe(self._unsafe) if self._unsafe else "The light is off"
        return (
            f"{rig}; {self.n_complete} of {self._n_poses} poses are safe in {self._path}."
            f"{self._unclosed} "
            f"Go on with: halfangle resume {self._path}"
        )


def _finish_of(error: BaseException) -> Finish:
    """Return how a run ends that met `error`: a device that may come back pauses it, all else is a fault."""
    if isinstance(error, CancelledError):
        return Finish.ABORTED
    if isinstance(error, PausedError | KeyboardInterrupt | DeviceLostError | DeviceTimeoutError):
        return Finish.PAUSED
    return Finish.FAULT
