"""The poses of a capture as the window sees them: where each stands, and what was seen of it."""

from __future__ import annotations

from enum import Enum

from PySide6.QtCore import QObject, Signal

from gui.capture.model import CaptureModel
from instrument.session.preview import Preview
from protocols.capture.progress import PoseBegun, PoseTaken, Progress
from protocols.planning.estimate import Outlook
from protocols.planning.planned_poses import PlannedPoses


class PoseState(Enum):
    """Where a pose stands."""

    PLANNED = "planned"
    CURRENT = "current"
    COMPLETE = "complete"
    MISSED = "missed"


class SeenPoses(QObject):
    """Follows what a capture tells.

    Parameters
    ----------
    capture : CaptureModel
    """

    changed = Signal()  # poses, or where they stand
    taken = Signal(object)  # protocols.capture.progress.PoseTaken

    def __init__(self, capture: CaptureModel) -> None:
        super().__init__(capture)
        self.planned: PlannedPoses | None = None
        self.states: list[PoseState] = []
        self.previews: dict[int, Preview] = {}
        """Of the poses that were taken, in this run or before."""
        capture.planned.connect(self._plan)
        capture.progressed.connect(self._hear)
        capture.released.connect(self._end)

    @property
    def current(self) -> int | None:
        """The pose that is being taken, or else the last one that was not finished."""
        for state in (PoseState.CURRENT, PoseState.MISSED):
            if state in self.states:
                return self.states.index(state)
        return None

    def _plan(self, outlook: Outlook) -> None:
        if outlook.planned is not None:
            self._expect(outlook.planned)

    def _hear(self, progress: Progress) -> None:
        news = progress.news
        if isinstance(news, PlannedPoses):
            self._expect(news)
        elif isinstance(news, PoseBegun):
            self._mark(news.i_pose, PoseState.CURRENT)
        elif isinstance(news, PoseTaken):
            self.previews = {**self.previews, news.i_pose: news.preview}
            self._mark(news.i_pose, PoseState.COMPLETE)
            self.taken.emit(news)

    def _expect(self, planned: PlannedPoses) -> None:
        done = planned.complete
        self.planned, self.previews = planned, dict(planned.previews)
        self.states = [PoseState.COMPLETE if i in done else PoseState.PLANNED for i in range(planned.n_poses)]
        self.changed.emit()

    def _mark(self, i_pose: int, state: PoseState) -> None:
        if self.states[i_pose] is not state:
            self.states[i_pose] = state
            self.changed.emit()

    def _end(self) -> None:
        if PoseState.CURRENT in self.states:
            self._mark(self.states.index(PoseState.CURRENT), PoseState.MISSED)
