"""While a capture runs: normals of what was taken so far, half angles reached, where one more pose would help most."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QShowEvent
from PySide6.QtWidgets import QSplitter, QVBoxLayout, QWidget

from gui.capture.poses import SeenPoses
from gui.widgets.newest import Newest
from gui.widgets.plots import OKABE_ITO, Picture, Plot
from gui.widgets.text import selectable
from instrument.session.preview import Preview
from protocols.planning.planned_poses import PlannedPoses

if TYPE_CHECKING:
    from analysis.quick_look.quick_look import QuickLook
    from protocols.planning.next_pose import NextPose

REST = 1.0
"""It rests as long as it worked, so that the capture has at least half of a processor more."""


@dataclass(frozen=True, eq=False)
class Shown:
    """A quick look, ready to be shown.

    Attributes
    ----------
    look : QuickLook
    next_pose : NextPose or None
    colours : ndarray of uint8, shape (H, W, 3)
        Of the normals.
    """

    look: QuickLook
    next_pose: NextPose | None
    colours: NDArray[np.uint8]


class QuickLookTab(QWidget):
    """Looks at the poses of a capture in a thread of its own, as long as somebody looks at this tab.

    Parameters
    ----------
    poses : SeenPoses
    parent : QWidget, optional
        As in Qt.
    """

    failed = Signal(str)
    shown = Signal()

    def __init__(self, poses: SeenPoses, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._poses = poses
        self.picture = Picture()
        self.picture.setAccessibleName(self.tr("Normals of the poses so far"))
        self.plot = Plot()
        self.plot.setAccessibleName(self.tr("Views by half angle"))
        self.bars = pg.BarGraphItem(x0=[], width=[], height=[], brush=OKABE_ITO["sky blue"])
        self.text_label = selectable(self.tr("nothing has been captured yet"), self.tr("What the poses so far tell"))
        self._worker = Newest(_looked_at, self, rest=REST)
        self._worker.done.connect(self.show_look)
        self._worker.failed.connect(self.failed)
        poses.taken.connect(self._ask)
        self._lay_out()

    @property
    def is_working(self) -> bool:
        """Whether anything was asked of the thread."""
        return self._worker.isRunning()

    def close_worker(self) -> None:
        """Wait for the look under way."""
        self._worker.close()

    def showEvent(self, event: QShowEvent) -> None:
        """Look at what was taken meanwhile; Qt calls this."""
        super().showEvent(event)
        self._ask()

    def show_look(self, shown: Shown) -> None:
        """Show a quick look."""
        self.picture.show_image(shown.colours)
        coverage = shown.look.coverage
        if coverage is not None:
            edges = coverage.edges_deg
            self.bars.setOpts(x0=edges[:-1], width=np.diff(edges), height=coverage.all_over)
        self.text_label.setText("\n".join(self._lines(shown)))
        self.shown.emit()

    def _lines(self, shown: Shown) -> list[str]:
        look = shown.look
        lines = [self.tr("poses looked at: {count}").format(count=len(look.used))]
        if look.dark:
            dark = ", ".join(str(i_pose + 1) for i_pose in look.dark)
            lines.append(self.tr("left out, since their pictures are black: {poses}").format(poses=dark))
        if look.problems:
            lines += [self.tr("no normals yet: {why}").format(why=why) for why in look.problems]
        else:
            sigma = f"{look.median_sigma_deg:.1f}"
            lines.append(
                self.tr("normals: {sigma} deg by the scatter of the views; nominal places add two or more").format(
                    sigma=sigma
                )
            )
        if look.coverage is not None:
            lines += look.coverage.advice()
        if shown.next_pose is not None:
            lines.append(shown.next_pose.as_text())
        return lines

    def _ask(self) -> None:
        planned, previews = self._poses.planned, self._poses.previews
        if planned is not None and previews and self.isVisible():
            self._worker.ask((planned, previews))

    def _lay_out(self) -> None:
        self.plot.addItem(self.bars)
        self.plot.setMouseEnabled(x=False, y=False)
        self.plot.setLabel("bottom", self.tr("half angle, deg"))
        self.plot.setLabel("left", self.tr("views of a point"))
        columns = QSplitter(Qt.Orientation.Horizontal)
        columns.addWidget(self.picture)
        columns.addWidget(self.plot)
        columns.setSizes([3, 2])
        column = QVBoxLayout(self)
        column.addWidget(columns, stretch=1)
        column.addWidget(self.text_label)


def _looked_at(asked: tuple[PlannedPoses, dict[int, Preview]]) -> Any:
    # Here, and not above: they take seconds to import, for which the window would not open.
    from analysis.drawing.colours import normal_colours
    from analysis.quick_look.quick_look import quick_look
    from protocols.planning.next_pose import next_pose

    planned, previews = asked
    look = quick_look(planned.views, previews)
    colours = np.asarray(255.0 * normal_colours(look.normals), np.uint8)
    return Shown(look, next_pose(planned, look.used), colours)
