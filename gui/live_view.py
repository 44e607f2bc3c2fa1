"""The live picture: what clips, is black or is sharp is marked; a histogram, and the raw count at the cursor."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF
from PySide6.QtWidgets import QCheckBox, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from drivers.camera import CameraDescription
from gui.live_facts import BLACK, CLIPPED, N_BINS, SHARP, LiveFacts

# Told apart with any kind of sight, after Okabe and Ito: vermillion, blue, yellow.
MARK_COLOURS = {CLIPPED: (213, 94, 0), BLACK: (0, 114, 178), SHARP: (240, 228, 66)}
MARK_TEXTS = {CLIPPED: "Clipped", BLACK: "Black", SHARP: "In focus"}
CHANNEL_COLOURS = {"R": "#d55e00", "G": "#009e73", "B": "#0072b2", "grey": "#808080"}


class LiveView(QWidget):
    """Shows frames of one camera; wheel to zoom, drag to pan."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._counts: NDArray[np.uint16] = np.zeros((0, 0), np.uint16)
        self.canvas = pg.GraphicsView()
        self._box = pg.ViewBox(lockAspect=True, invertY=True, enableMenu=False)
        # Rows first, as in numpy: pyqtgraph's own default shows pictures transposed.
        self.picture = pg.ImageItem(axisOrder="row-major")
        self.marks = pg.ImageItem(axisOrder="row-major")
        self.canvas.setCentralItem(self._box)
        self._box.addItem(self.picture)
        self._box.addItem(self.marks)
        self.switches = {mark: QCheckBox(text) for mark, text in MARK_TEXTS.items()}
        for mark, switch in self.switches.items():
            switch.setChecked(mark == CLIPPED)
            switch.toggled.connect(self._colour_marks)
        self.histogram = pg.PlotWidget()
        self.clip_line = pg.InfiniteLine(angle=90, pen=pg.mkPen(MARK_COLOURS[CLIPPED], width=2))
        self.counts_label = QLabel("no frame yet")
        self.cursor_label = QLabel()
        self._edges = np.arange(N_BINS, dtype=float)
        self._bars: dict[str, pg.PlotDataItem] = {}
        self._lay_out()
        self._colour_marks()
        self._box.scene().sigMouseMoved.connect(self._show_cursor)

    def expect(self, camera: CameraDescription) -> None:
        """Take clipping and depth from `camera`, and fit the view to its frames."""
        top = 2**camera.bit_depth
        self.picture.setLevels((0, 255))
        self.clip_line.setValue(camera.saturation_level)
        self.histogram.setXRange(0, top, padding=0.02)
        self._edges = np.arange(N_BINS) * top / N_BINS
        self._box.setRange(xRange=(0, camera.width), yRange=(0, camera.height), padding=0.02)

    def show_frame(self, counts: NDArray[np.uint16], facts: LiveFacts) -> None:
        """Show one frame of raw counts, shape (height, width), and what was seen of it."""
        self._counts = counts
        self.picture.setImage(facts.shown, autoLevels=False)
        self.marks.setImage(facts.marks, autoLevels=False, levels=(0, len(MARK_COLOURS)))
        for name, values in facts.histogram.items():
            # The logarithm of an empty bin is nowhere.
            self._bar(name).setData(self._edges, np.maximum(values, 0.5))
        self.counts_label.setText(
            f"median {facts.median:.0f} counts; {100 * facts.clipped:.2f} % clipped, {100 * facts.black:.2f} % black; "
            f"focus {facts.focus:.3f}"
        )

    def _bar(self, name: str) -> pg.PlotDataItem:
        if name not in self._bars:
            self._bars[name] = self.histogram.plot(pen=pg.mkPen(CHANNEL_COLOURS[name], width=1), name=name)
        return self._bars[name]

    def _colour_marks(self) -> None:
        """Make the marks that are switched on visible."""
        table = np.zeros((len(MARK_COLOURS) + 1, 4), np.uint8)
        for mark, switch in self.switches.items():
            table[mark] = (*MARK_COLOURS[mark], 255 if switch.isChecked() else 0)
        self.marks.setLookupTable(table)

    def _show_cursor(self, position: QPointF) -> None:
        point = self._box.mapSceneToView(position)
        row, column = int(np.floor(point.y())), int(np.floor(point.x()))
        inside = 0 <= row < self._counts.shape[0] and 0 <= column < self._counts.shape[1]
        self.cursor_label.setText(f"({column}, {row}): {self._counts[row, column]} counts" if inside else "")

    def _lay_out(self) -> None:
        self.histogram.setLogMode(x=False, y=True)
        self.histogram.addItem(self.clip_line)
        self.histogram.setFixedHeight(120)
        self.histogram.setMouseEnabled(x=False, y=False)
        below = QHBoxLayout()
        for switch in self.switches.values():
            below.addWidget(switch)
        below.addWidget(self.cursor_label)
        below.addStretch()
        below.addWidget(self.counts_label)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.canvas, stretch=1)
        layout.addLayout(below)
        layout.addWidget(self.histogram)
