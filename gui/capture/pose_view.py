"""The poses of a capture over the sample, the one that counts named in words."""

from __future__ import annotations

from collections import Counter

from PySide6.QtCore import QCoreApplication
from PySide6.QtWidgets import QVBoxLayout, QWidget

from gui.capture.pose_canvas import PoseCanvas
from gui.capture.pose_signs import SIGNS
from gui.capture.poses import PoseState, SeenPoses
from gui.widgets.text import QT_TRANSLATE_NOOP, selectable

CONTEXT = "PoseState"

TEXTS = {
    PoseState.PLANNED: QT_TRANSLATE_NOOP("PoseState", "{count} planned"),
    PoseState.CURRENT: QT_TRANSLATE_NOOP("PoseState", "{count} being taken"),
    PoseState.COMPLETE: QT_TRANSLATE_NOOP("PoseState", "{count} complete"),
    PoseState.MISSED: QT_TRANSLATE_NOOP("PoseState", "{count} not finished"),
}


class PoseView(QWidget):
    """Mirrors the poses of a capture.

    Parameters
    ----------
    poses : SeenPoses
    parent : QWidget, optional
        As in Qt.
    """

    def __init__(self, poses: SeenPoses, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._poses = poses
        self.canvas = PoseCanvas()
        self.canvas.setAccessibleName(self.tr("Poses over the sample"))
        self.canvas.setToolTip(self.tr("Drag or arrow keys turn it; click or Page up and Page down name a pose"))
        self.name_label = selectable("", self.tr("The pose that is marked"))
        self.count_label = selectable("", self.tr("How many poses stand where"))
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        for part in (self.canvas, self.name_label, self.count_label):
            column.addWidget(part, stretch=1 if part is self.canvas else 0)
        self.canvas.chosen.connect(self._name)
        poses.changed.connect(self._show)
        self._show()

    def _show(self) -> None:
        planned, states = self._poses.planned, self._poses.states
        self.setVisible(planned is not None)
        if planned is None:
            return
        self.canvas.show_poses(planned.views.lens, states, planned.rig.geometry.area_mm)
        counts = Counter(states)
        parts = [
            f"{SIGNS[state]} {QCoreApplication.translate(CONTEXT, text).format(count=counts[state])}"
            for state, text in TEXTS.items()
            if counts[state]
        ]
        self.count_label.setText("   ".join(parts))
        self._name(self._poses.current)

    def _name(self, i_pose: int | None) -> None:
        planned = self._poses.planned
        self.canvas.name_pose(i_pose)
        self.name_label.setText("" if planned is None or i_pose is None else planned.name(i_pose))
