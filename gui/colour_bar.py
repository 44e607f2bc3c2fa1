"""What the colours of a map mean: a bar with its values and their unit."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QRectF
from PySide6.QtWidgets import QSizePolicy, QWidget

from gui.map_picture import MapPicture
from gui.plots import Plot

_WIDTH_LETTERS = 12


class ColourBar(Plot):
    """Upright; hidden where colours are no scale."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setMouseEnabled(x=False, y=False)
        self.getPlotItem().hideAxis("bottom")
        self.getPlotItem().hideButtons()
        self.bar = pg.ImageItem(axisOrder="row-major")
        self.addItem(self.bar)
        self.setMaximumWidth(_WIDTH_LETTERS * self.fontMetrics().averageCharWidth())
        self.setSizePolicy(QSizePolicy.Policy.Preferred, QSizePolicy.Policy.Expanding)
        self.hide()

    def show_scale(self, picture: MapPicture, name: str) -> None:
        """Show the scale of a map, or nothing."""
        self.setVisible(picture.span is not None)
        if picture.span is None or picture.table is None:
            return
        low, high = picture.span
        self.bar.setImage(picture.table[1:, None], levels=(0, 255))
        self.bar.setRect(QRectF(0.0, low, 1.0, high - low))
        unit = picture.shown.unit
        self.setLabel("left", f"{name}, {unit}" if unit else name)
        self.getPlotItem().getAxis("left").enableAutoSIPrefix(False)
        self.setRange(xRange=(0.0, 1.0), yRange=(low, high), padding=0.0)
        self.setAccessibleName(f"{name}: {np.format_float_positional(low, 4)} to {high:.4g} {unit}")
