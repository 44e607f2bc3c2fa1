"""One pixel of a result: its samples against the fitted curve, and over which half angles it was seen."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtWidgets import QWidget

from gui.widgets.plots import CHANNEL_COLOURS, Plot

if TYPE_CHECKING:
    from analysis.results.points import PointCurve, PointSamples

Array = NDArray[np.float64]

# A shape each, beside the colour.
SYMBOLS = {"R": "o", "G": "t", "B": "s", "grey": "o"}

_SEEN = (128, 128, 128, 50)

_ROOM = 2.0  # times that the axis reaches beyond the curve


def channel_names(n_channels: int) -> tuple[str, ...]:
    """Return what the channels are called."""
    return ("R", "G", "B") if n_channels == 3 else ("grey",)


class PointPlot(Plot):
    """BRDF over half angle on a logarithmic axis; hollow dots were not used as they are."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName(self.tr("Samples and curve of the point"))
        self.setLogMode(x=False, y=True)
        self.setLabel("bottom", self.tr("half angle, deg"))
        self.setLabel("left", self.tr("BRDF, 1/sr"))
        self.getPlotItem().getAxis("left").enableAutoSIPrefix(False)
        self.seen_band = pg.LinearRegionItem(brush=_SEEN, pen=_SEEN, movable=False)
        self.seen_band.setZValue(-1)
        self.addItem(self.seen_band)
        self.seen_band.hide()
        self.curves: list[pg.PlotDataItem] = []
        self.dots: list[pg.PlotDataItem] = []

    def show_curve(self, curve: PointCurve) -> None:
        """Show the curve of a point, without samples as yet."""
        self.clear_point()
        angles = np.rad2deg(curve.theta_h)
        self.curves = [
            self.plot(angles, np.where(f > 0.0, f, np.nan), pen=pg.mkPen(CHANNEL_COLOURS[name], width=2))
            for name, f in zip(channel_names(curve.f.shape[1]), curve.f.T, strict=True)
        ]
        seen = np.rad2deg(curve.seen)
        self.seen_band.setVisible(bool(np.isfinite(seen).all()))
        if np.isfinite(seen).all():
            self.seen_band.setRegion(seen)
        self._fit(angles, curve.f)

    def show_samples(self, samples: PointSamples) -> int:
        """Show samples; return how many lie below zero, where this axis has no place."""
        from analysis.results.points import USED

        self._remove(self.dots)
        self.dots = []
        for channel, name in enumerate(channel_names(samples.f.shape[1])):
            f, is_used = samples.f[:, channel], samples.use[:, channel] == USED
            for filled in (True, False):
                self.dots.append(self._dots(samples.theta_h, f, is_used == filled, name, filled=filled))
        return int(np.sum(samples.f <= 0.0))

    def clear_point(self) -> None:
        """Show nothing."""
        self._remove(self.curves + self.dots)
        self.curves, self.dots = [], []
        self.seen_band.hide()

    def _dots(self, theta_h: Array, f: Array, which: NDArray[np.bool_], name: str, *, filled: bool) -> pg.PlotDataItem:
        shown = which & (f > 0.0)
        colour = CHANNEL_COLOURS[name]
        return self.plot(
            np.rad2deg(theta_h[shown]),
            f[shown],
            pen=None,
            symbol=SYMBOLS[name],
            symbolSize=7,
            symbolPen=pg.mkPen(colour),
            symbolBrush=pg.mkBrush(colour) if filled else None,
        )

    def _fit(self, angles: Array, f: Array) -> None:
        positive = f[np.isfinite(f) & (f > 0.0)]
        if positive.size:
            low, high = np.log10(positive.min() / _ROOM), np.log10(positive.max() * _ROOM)
            self.setRange(xRange=(0.0, angles[-1]), yRange=(low, high), padding=0.02)

    def _remove(self, items: list[pg.PlotDataItem]) -> None:
        for item in items:
            self.removeItem(item)
