"""Raw counts as plots: the histogram with what clips and what is shown, and the profile along a line."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QWidget

from drivers.camera import CameraDescription
from gui.widgets.plots import CHANNEL_COLOURS, OKABE_ITO, Plot
from instrument.rig.frame_statistics import N_BINS, Counts, FrameFacts, profile

_HEIGHT_LINES = 7  # of text, at least

_SHOWN_BRUSH = (128, 128, 128, 40)


class HistogramPlot(Plot):
    """Pixels by raw counts on a logarithmic axis; the grey band, to be dragged, is what the picture shows."""

    window_changed = Signal(float, float)  # counts that are shown black and white

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.clip_line = pg.InfiniteLine(angle=90, pen=pg.mkPen(OKABE_ITO["vermillion"], width=2))
        self.window_band = pg.LinearRegionItem(brush=_SHOWN_BRUSH)
        self.window_band.setZValue(-1)
        self._left_edges = np.arange(N_BINS, dtype=float)
        self._curves: dict[str, pg.PlotDataItem] = {}
        self.setLogMode(x=False, y=True)
        self.addItem(self.window_band)
        self.addItem(self.clip_line)
        self.setMouseEnabled(x=False, y=False)
        self.setMinimumHeight(_HEIGHT_LINES * self.fontMetrics().height())
        self.setLabel("bottom", self.tr("raw counts"))
        self.window_band.sigRegionChanged.connect(lambda _: self.window_changed.emit(*self.window_band.getRegion()))

    def expect(self, camera: CameraDescription) -> None:
        """Take depth and clipping from `camera`, and show all between black and clipping."""
        top = 2**camera.bit_depth
        self.clip_line.setValue(camera.saturation_level)
        self.setXRange(0, top, padding=0.02)
        self._left_edges = np.arange(N_BINS) * top / N_BINS
        self.window_band.setBounds((0, top))
        self.set_window(camera.black_level, camera.saturation_level)

    @property
    def window_counts(self) -> tuple[float, float]:
        """Counts that are shown black and white."""
        low, high = self.window_band.getRegion()
        return low, high

    def set_window(self, low: float, high: float) -> None:
        """Show counts from `low` as black to `high` as white."""
        with QSignalBlocker(self.window_band):
            self.window_band.setRegion((low, high))
        self.window_changed.emit(low, high)

    def show_facts(self, facts: FrameFacts) -> None:
        """Show the histogram of a frame, a curve for each colour."""
        for name, values in facts.histogram.items():
            # The logarithm of an empty bin is nowhere.
            _curve(self, self._curves, name).setData(self._left_edges, np.maximum(values, 0.5))


class ProfilePlot(Plot):
    """Raw counts along a line, a curve for each colour of the mosaic."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._curves: dict[str, pg.PlotDataItem] = {}
        self.setLabel("bottom", self.tr("along the line, pixels"))
        self.setMinimumHeight(_HEIGHT_LINES * self.fontMetrics().height())

    def show_profile(self, counts: Counts, pattern: str, ends: tuple[tuple[float, float], tuple[float, float]]) -> None:
        """Show the counts between two ends, each row and column."""
        for name, (distance, values) in profile(counts, pattern, *ends).items():
            _curve(self, self._curves, name).setData(distance, values.astype(float))


def _curve(plot: Plot, curves: dict[str, pg.PlotDataItem], name: str) -> pg.PlotDataItem:
    if name not in curves:
        curves[name] = plot.plot(pen=pg.mkPen(CHANNEL_COLOURS[name], width=1), name=name)
    return curves[name]
