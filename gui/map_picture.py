"""A map as a picture: colours of a scale or of categories, what stands for unknown, and values in words."""

from __future__ import annotations

from functools import cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtGui import QColor

from gui.plots import OKABE_ITO

if TYPE_CHECKING:
    from analysis.results.maps import ResultMap

Pixels = NDArray[np.uint8]

UNKNOWN = (96, 96, 96)
"""Grey, which is in no scale."""

_SHADES = (1.0, 0.55, 0.3)  # of the categories' colours, round by round


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
