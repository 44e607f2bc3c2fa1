"""A capture that tells what a test says, without a rig."""

from __future__ import annotations

from typing import Any

import numpy as np
from PySide6.QtCore import QObject, Signal

from drivers.limits import Limits
from drivers.stage import AxisDescription
from gui.capture.poses import SeenPoses
from instrument.session.preview import Preview
from protocols.capture.progress import News, PoseBegun, PoseTaken, Progress, State
from protocols.planning.planned_poses import PlannedPoses
from protocols.poses.patterns import Pose, ring
from tests.protocols.fakes import HEIGHT, WIDTH, rig_config

AXES = (
    AxisDescription("tilt", "rotation", Limits(-60.0, 60.0, "deg"), 0.1, (1.0, 0.0, 0.0)),
    AxisDescription("turn", "rotation", Limits(-360.0, 360.0, "deg"), 0.1, (0.0, 0.0, 1.0)),
)


class ToldCapture(QObject):
    """Has the signals of `gui.capture.model.CaptureModel`."""

    planned = Signal(object)
    progressed = Signal(object)
    released = Signal()

    def seen(self) -> SeenPoses:
        capture: Any = self
        return SeenPoses(capture)

    def tell(self, news: News) -> None:
        self.progressed.emit(Progress(State.RUNNING, 0, 0, 0, 0.0, 0.0, "something", news=news))

    def take(self, *poses: int) -> None:
        for i_pose in poses:
            self.tell(PoseBegun(i_pose))
            self.tell(taken(i_pose))


def planned(*poses: Pose, complete: tuple[int, ...] = ()) -> PlannedPoses:
    """Return some poses, by default one straight above and four round it."""
    places = poses or (*ring(0.0, 1), *ring(30.0, 4))
    return PlannedPoses(rig_config(), AXES, tuple(places), HEIGHT, WIDTH, frozenset(complete))


def taken(i_pose: int) -> PoseTaken:
    """Return a bracket of three frames, each brighter than the last; the longest clips by half."""
    thumbnails = np.stack([np.full((6, 8), level, np.uint8) for level in (10, 100, 255)])
    picture = np.random.default_rng(i_pose).uniform(500.0, 1000.0, (HEIGHT // 2, WIDTH // 2)).astype(np.float32)
    clipped = np.array([0.0, 1e-5, 0.5])
    return PoseTaken(i_pose, thumbnails, np.array([0.002, 0.01, 0.05]), clipped, Preview(picture, 1e6))
