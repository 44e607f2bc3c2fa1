"""The live picture at full bit depth: marks, boards, a region and a line to measure, and raw counts everywhere."""

from __future__ import annotations

from collections.abc import Sequence

import pyqtgraph as pg
from PySide6.QtCore import QRectF, Qt, QTimer, Signal
from PySide6.QtWidgets import QCheckBox, QGridLayout, QHBoxLayout, QSplitter, QVBoxLayout, QWidget

from drivers.camera import CameraDescription
from gui.live.board_overlay import BoardOverlay
from gui.live.counts_plots import HistogramPlot, ProfilePlot
from gui.live.picture import Look, Wanted, colour_table, look_at
from gui.widgets.newest import Newest
from gui.widgets.plots import OKABE_ITO, Picture
from gui.widgets.text import QT_TRANSLATE_NOOP, selectable
from instrument.config.boards import BoardConfig
from instrument.rig.frame_statistics import BLACK, CLIPPED, SHARP, Counts, Region

MARK_TEXTS = {
    CLIPPED: QT_TRANSLATE_NOOP("LiveView", "Cli&pped"),
    BLACK: QT_TRANSLATE_NOOP("LiveView", "&Black"),
    SHARP: QT_TRANSLATE_NOOP("LiveView", "In &focus"),
}

_STEPS = (1, 2, 4, 8)

_PLOT_PERIOD_MS = 100

_TOOL_PEN = pg.mkPen(OKABE_ITO["purple"], width=2)


class LiveView(QWidget):
    """Shows frames of one camera.

    Parameters
    ----------
    boards : sequence of BoardConfig
        The marker boards of the rig, to be found in the picture.
    focal_length_px : float
        Nominal.
    parent : QWidget, optional
        As in Qt.
    """

    failed = Signal(str)  # why a frame could not be looked at

    def __init__(self, boards: Sequence[BoardConfig], focal_length_px: float, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._camera: CameraDescription | None = None
        self._look: Look | None = None
        self.looking = Newest(look_at, self)
        self.picture = Picture()
        self.picture.setAccessibleName(self.tr("Live picture"))
        self.switches = {mark: QCheckBox(self.tr(text)) for mark, text in MARK_TEXTS.items()}
        self.switches[CLIPPED].setChecked(True)
        self.board_switch = QCheckBox(self.tr("B&oards"))
        self.region_switch = QCheckBox(self.tr("Re&gion"))
        self.line_switch = QCheckBox(self.tr("Li&ne"))
        self.boards = BoardOverlay(self.picture, boards, focal_length_px, self)
        self.region = pg.RectROI((0, 0), (2, 2), pen=_TOOL_PEN)
        self.line = pg.LineSegmentROI([(0, 0), (1, 1)], pen=_TOOL_PEN)
        self.histogram = HistogramPlot()
        self.profile = ProfilePlot()
        self.facts_label = selectable(self.tr("no frame yet"), self.tr("Facts of the live picture"))
        self.cursor_label = selectable("", self.tr("Counts at the cursor"))
        self._table = colour_table()
        # Plots of every frame would keep the window's thread busy, and nobody reads so fast.
        self._plotting = QTimer(self, interval=_PLOT_PERIOD_MS, singleShot=True)
        self._lay_out()
        self._wire()

    def expect(self, camera: CameraDescription) -> None:
        """Take clipping and depth from `camera`, and fit view and tools to its frames."""
        before, self._camera = self._camera, camera
        # What the operator chose to see stays while the camera is the same, above all after each capture.
        if before is None or _levels(before) != _levels(camera):
            self.histogram.expect(camera)
        if self.picture.size_in_pixels != (camera.height, camera.width):
            self.picture.fit(camera.height, camera.width)
            self._place_tools(camera.height, camera.width)

    def take(self, counts: Counts) -> None:
        """Look at a frame of raw counts, shape (H, W), and show it as soon as that is done."""
        if self._camera is not None:
            self.looking.ask((counts, self._camera, self.wanted))
            if self.board_switch.isChecked():
                self.boards.take(counts, self._camera)

    @property
    def wanted(self) -> Wanted:
        """What the switches and tools ask for."""
        marks = frozenset(mark for mark, switch in self.switches.items() if switch.isChecked())
        low, high = self.histogram.window_counts
        return Wanted(low, high, marks, self._region() if self.region_switch.isChecked() else None, self._step())

    def close_workers(self) -> None:
        """Join the threads."""
        self.looking.close()
        self.boards.close()

    def show_look(self, look: Look) -> None:
        """Show one frame that was looked at."""
        self._look = look
        self.picture.show_image(look.image, self._table, look.step, look.counts.shape)
        if not self._plotting.isActive():
            self._plotting.start()

    def show_plots(self) -> None:
        """Show histogram, profile and numbers of the newest frame, as happens by itself ten times a second."""
        if self._look is None:
            return
        facts = self._look.facts
        self.histogram.show_facts(facts)
        self._show_profile()
        self.facts_label.setText(
            self.tr(
                "median {median:.0f} counts; {clipped:.2f} % clipped, {black:.2f} % black; focus {focus:.3f}"
            ).format(median=facts.median, clipped=100 * facts.clipped, black=100 * facts.black, focus=facts.focus)
        )

    def _look_again(self) -> None:
        """Show the last frame anew, as is wanted now."""
        if self._look is not None and self._camera is not None:
            self.looking.ask((self._look.counts, self._camera, self.wanted))

    def _show_profile(self) -> None:
        if self._look is not None and self._camera is not None and self.line_switch.isChecked():
            ends = [self.line.mapToParent(end.pos()) for end in self.line.endpoints]
            start, end = ((end.y(), end.x()) for end in ends)
            self.profile.show_profile(self._look.counts, self._camera.bayer_pattern, (start, end))

    def _step(self) -> int:
        return next((step for step in _STEPS if self.picture.pixels_per_dot <= step), _STEPS[-1])

    def _region(self) -> Region:
        shape = QRectF(self.region.pos(), self.region.pos() + self.region.size())
        return Region(*(round(n) for n in (shape.top(), shape.left(), shape.bottom(), shape.right())))

    def _show_cursor(self, row: int, column: int) -> None:
        if self._look is None or row >= self._look.counts.shape[0] or column >= self._look.counts.shape[1]:
            return
        text = self.tr("row {row}, column {column}: {counts} counts")
        self.cursor_label.setText(text.format(row=row, column=column, counts=self._look.counts[row, column]))

    def _place_tools(self, height: int, width: int) -> None:
        self.region.setPos(0.4 * width, 0.4 * height)
        self.region.setSize((0.2 * width, 0.2 * height))
        for end, x in zip(self.line.endpoints, (0.25 * width, 0.75 * width), strict=True):
            self.line.movePoint(end, pg.Point(x, 0.5 * height), coords="parent")

    def _wire(self) -> None:
        self.looking.done.connect(self.show_look)
        for worker in (self.looking, self.boards.finding):
            worker.failed.connect(self.failed)
        self._plotting.timeout.connect(self.show_plots)
        self.boards.switch_to(on=False)
        for switch in self.switches.values():
            switch.toggled.connect(self._look_again)
        for switch, tool in ((self.region_switch, self.region), (self.line_switch, self.line)):
            tool.setVisible(False)
            switch.toggled.connect(tool.setVisible)
        self.region_switch.toggled.connect(self._look_again)
        self.region.sigRegionChanged.connect(lambda _: self._look_again())
        self.line_switch.toggled.connect(self.profile.setVisible)
        self.line_switch.toggled.connect(self._show_profile)
        self.line.sigRegionChanged.connect(lambda _: self._show_profile())
        self.board_switch.toggled.connect(lambda on: self.boards.switch_to(on=on))
        self.histogram.window_changed.connect(lambda *_: self._look_again())
        self.picture.pointed.connect(self._show_cursor)
        self.picture.box.sigRangeChanged.connect(lambda *_: self._look_again())

    def _lay_out(self) -> None:
        for tool in (self.region, self.line):
            self.picture.box.addItem(tool)
        self.profile.setVisible(False)
        switches = QGridLayout()
        tools = (self.board_switch, self.region_switch, self.line_switch)
        for row, part in enumerate((self.switches.values(), tools)):
            for i_column, switch in enumerate(part):
                switches.addWidget(switch, row, i_column)
        switches.setColumnStretch(len(tools), 1)
        plots = QHBoxLayout()
        plots.addWidget(self.histogram, stretch=1)
        plots.addWidget(self.profile, stretch=1)
        below = QWidget()
        below.setLayout(plots)
        plots.setContentsMargins(0, 0, 0, 0)
        parts = QSplitter(Qt.Orientation.Vertical)
        parts.addWidget(self.picture)
        parts.addWidget(below)
        parts.setStretchFactor(0, 1)
        # The plots begin as low as they may be: the rest is for the picture.
        parts.setSizes([10_000, 1])
        column = QVBoxLayout(self)
        column.addLayout(switches)
        column.addWidget(parts, stretch=1)
        for label in (self.facts_label, self.boards.label, self.cursor_label):
            column.addWidget(label)


def _levels(camera: CameraDescription) -> tuple[int, float, float]:
    return camera.bit_depth, camera.black_level, camera.saturation_level
