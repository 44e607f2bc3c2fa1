"""A capture as the window sees it: what can be asked of it, and what it tells."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtCore import QObject, Signal

from gui.rig.rig_use import RigUse
from gui.widgets.job import Job, Work
from instrument.config.rig import RigConfig
from instrument.rig.rig import OpenDevices
from protocols.capture import engine
from protocols.capture.progress import Finish, Outcome
from protocols.planning.estimate import Outlook, estimate
from protocols.planning.python_protocol import load_any_protocol


class CaptureModel(QObject):
    """Plans, begins, pauses, resumes and aborts; one thing at a time, with the rig to itself.

    Parameters
    ----------
    config : RigConfig
        The rig.
    devices : callable
        Makes the devices of `config`.
    rig_use : RigUse
        Hands over the rig.
    """

    begun = Signal()
    progressed = Signal(object)  # protocols.capture.progress.Progress
    planned = Signal(object)  # protocols.planning.estimate.Outlook
    ended = Signal(object)  # protocols.capture.progress.Outcome
    failed = Signal(str)  # what went wrong, which, what next
    released = Signal()  # the rig is free again

    def __init__(self, config: RigConfig, devices: OpenDevices, rig_use: RigUse) -> None:
        super().__init__(rig_use)
        self._config, self._devices, self._rig_use = config, devices, rig_use
        rig_use.job_began.connect(self._follow)
        rig_use.job_ended.connect(self.released)

    def plan(self, protocol: Path) -> None:
        """Say what a protocol would do."""
        self._begin(lambda watch, control: estimate(self._config, load_any_protocol(protocol), self._devices))

    def start(self, protocol: Path, session: Path) -> None:
        """Capture a protocol into a new session."""
        self._begin(
            lambda watch, control: engine.capture(
                self._config, load_any_protocol(protocol), session, watch, self._devices, control
            )
        )

    def resume(self, session: Path) -> None:
        """Go on with a session."""
        self._begin(lambda watch, control: engine.resume(session, watch, self._devices, control))

    def pause(self) -> None:
        """Ask to stop after the pose that is being taken."""
        self._rig_use.pause()

    def abort(self) -> None:
        """End it at once, with the light off."""
        self._rig_use.abort()

    def _begin(self, work: Work) -> None:
        if not self._rig_use.is_busy:
            self.begun.emit()
            self._rig_use.begin(work)

    def _follow(self, job: Job) -> None:
        job.progressed.connect(self.progressed)
        job.succeeded.connect(self._conclude)
        job.failed.connect(self.failed)

    def _conclude(self, result: Outlook | Outcome) -> None:
        if isinstance(result, Outlook):
            self.planned.emit(result)
            return
        self.ended.emit(result)
        job = self._rig_use.job
        if result.finish is not Finish.COMPLETE and not (job is not None and job.stop_asked):
            self.failed.emit(result.message)
