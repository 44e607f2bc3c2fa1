"""What is known of the point that is picked: its curve at once, its samples as soon as their stack has been found."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from PySide6.QtCore import QCoreApplication
from PySide6.QtWidgets import QVBoxLayout, QWidget

from gui.result.point_plot import PointPlot
from gui.widgets.newest import Newest
from gui.widgets.text import QT_TRANSLATE_NOOP, selectable

if TYPE_CHECKING:
    from analysis.results.points import PointCurve, PointSamples, PointSource

COUNTS = (
    QT_TRANSLATE_NOOP("PointView", "{n} samples used"),
    QT_TRANSLATE_NOOP("PointView", "{n} clipped (a lower bound)"),
    QT_TRANSLATE_NOOP("PointView", "{n} that do not fit (weighed down)"),
    QT_TRANSLATE_NOOP("PointView", "{n} not seen"),
)
"""In the order of `analysis.results.points.USES`."""


class PointView(QWidget):
    """Reads in threads of their own."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.plot = PointPlot()
        self.curve_label = selectable(self.tr("click into the map, or press Enter there"), self.tr("The point"))
        self.samples_label = selectable(name=self.tr("Samples of the point"))
        self.fitting = Newest(_curve, self)
        self.sampling = Newest(_samples, self)
        self.fitting.done.connect(self._show_curve)
        self.fitting.failed.connect(self.curve_label.setText)
        self.sampling.done.connect(self._show_samples)
        # A curve without its samples is worth showing; the label says why it is alone.
        self.sampling.failed.connect(self.samples_label.setText)
        self._source: PointSource | None = None
        self._point: tuple[int, int] | None = None
        self._lay_out()

    def take(self, source: PointSource) -> None:
        """Show points of that result from now on."""
        self._source = source
        self._point = None
        self.plot.clear_point()
        self.curve_label.setText(self.tr("click into the map, or press Enter there"))
        self.samples_label.setText("")

    def show_point(self, row: int, column: int) -> None:
        """Show a pixel of the result."""
        self._point = (row, column)
        self.samples_label.setText(self.tr("looking for the samples"))
        self.fitting.ask((self._source, row, column))

    def close_workers(self) -> None:
        """Wait for what is being read."""
        self.fitting.close()
        self.sampling.close()

    def _show_curve(self, curve: PointCurve) -> None:
        if (curve.row, curve.column) != self._point:
            return
        self.plot.show_curve(curve)
        near, far, sigma = np.rad2deg([*curve.seen, curve.normal_sigma])
        told = self.tr("row {row}, column {column}").format(row=curve.row, column=curve.column)
        if np.isfinite(sigma):
            text = self.tr(": seen from {near:.0f} to {far:.0f} deg, normal known to {sigma:.2f} deg (one sigma)")
            told += text.format(near=near, far=far, sigma=sigma)
        self.curve_label.setText("; ".join([told, *curve.flags]))
        self.sampling.ask((self._source, curve.row, curve.column))

    def _show_samples(self, found: _Found) -> None:
        if (found.row, found.column) != self._point:
            return
        told = [
            QCoreApplication.translate("PointView", text).format(n=n)
            for text, n in zip(COUNTS, found.counts, strict=True)
            if n
        ]
        n_below = self.plot.show_samples(found.samples)
        if n_below:
            told.append(self.tr("{n} below zero are not drawn").format(n=n_below))
        if found.samples.f.shape[1] == 3:
            told.append(self.tr("R circle, G triangle, B square; hollow: not used as it is"))
        self.samples_label.setText("; ".join(told))

    def _lay_out(self) -> None:
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.plot, stretch=1)
        column.addWidget(self.curve_label)
        column.addWidget(self.samples_label)


class _Found(NamedTuple):
    row: int
    column: int
    samples: PointSamples
    counts: tuple[int, ...]


def _curve(asked: tuple[PointSource, int, int]) -> PointCurve:
    from analysis.results.points import point_curve

    source, row, column = asked
    return point_curve(source.result, row, column)


def _samples(asked: tuple[PointSource, int, int]) -> _Found:
    from analysis.results.points import counts_by_use

    source, row, column = asked
    samples = source.at(row, column)
    return _Found(row, column, samples, counts_by_use(samples))
