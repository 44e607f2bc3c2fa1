"""A map as a picture: colours of a scale or of categories, what stands for unknown, and values in words."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtGui import QColor

from gui.widgets.plots import OKABE_ITO

if TYPE_CHECKING:
    from analysis.results.maps import ResultMap
from PySide6.QtCore import QRectF
from PySide6.QtWidgets import QSizePolicy, QWidget

from gui.widgets.plots import Plot

Pixels = NDArray[np.uint8]

UNKNOWN = (96, 96, 96)
"""Grey, which is in no scale."""

_SHADES = (1.0, 0.55, 0.3)  # of the categories' colours, round by round

_WIDTH_LETTERS = 12


class MapPicture(NamedTuple):
    """What a picture shows of a map.

    Attributes
    ----------
    image : ndarray of uint8, shape (H, W) or (H, W, 3)
    table : ndarray of uint8, shape (256, 3), or None
        Colours of an image without any; 0 stands for unknown.
    span : tuple of float or None
        Values of the table's entries 1 and 255, where it is a scale.
    shown : ResultMap
    """

    image: Pixels
    table: Pixels | None
    span: tuple[float, float] | None
    shown: ResultMap

    def text_at(self, row: int, column: int) -> str:
        """Return the value of a pixel in words."""
        value = self.shown.values[row, column]
        if value.ndim:
            return "(" + ", ".join(f"{v:.4g}" for v in value) + ")"
        return f"{value:.4g} {self.shown.unit}".strip()


def map_picture(shown: ResultMap) -> MapPicture:
    """Draw a map; runs in any thread."""
    if shown.colours is not None:
        image = (255.0 * np.clip(shown.colours, 0.0, 1.0)).astype(np.uint8)
        return MapPicture(image, None, None, shown)
    if shown.kind.value == "categories":
        table = category_table()
        # As many as there are entries; more materials than that nobody tells apart.
        image = np.clip(np.nan_to_num(shown.values, nan=-1.0) + 1.0, 0, len(table) - 1).astype(np.uint8)
        return MapPicture(image, table, None, shown)
    low, high = shown.span
    scaled = 1.0 + 254.0 * np.clip((shown.values - low) / (high - low), 0.0, 1.0)
    return MapPicture(np.nan_to_num(scaled).astype(np.uint8), scale_table(), (low, high), shown)


@cache
def scale_table() -> Pixels:
    """Return viridis behind the colour for unknown, shape (256, 3)."""
    colours = pg.colormap.get("viridis").getLookupTable(nPts=255, alpha=False)
    return np.concatenate([[UNKNOWN], colours]).astype(np.uint8)


@cache
def category_table() -> Pixels:
    """Return a colour for each category behind the one for unknown, shape (256, 3)."""
    hues = np.array([[c.red(), c.green(), c.blue()] for c in map(QColor, OKABE_ITO.values())])
    rounds = np.concatenate([shade * hues for shade in _SHADES])
    repeated = np.resize(rounds, (255, 3))
    return np.concatenate([[UNKNOWN], repeated]).astype(np.uint8)


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
