"""How many views see a point at which half angle, and where there are too few."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QCoreApplication, Qt
from PySide6.QtWidgets import QWidget

from analysis.registration.coverage import BIN_DEG, JUDGED_TO_DEG, MIN_VIEWS, MIN_VIEWS_FIRST, Coverage
from gui.widgets.plots import OKABE_ITO, Plot
from gui.widgets.text import QT_TRANSLATE_NOOP

# A colour and a kind of line each.
_SLOPES = {
    "left": (OKABE_ITO["blue"], Qt.PenStyle.SolidLine, QT_TRANSLATE_NOOP("HalfAnglesPlot", "facing left")),
    "right": (OKABE_ITO["orange"], Qt.PenStyle.DashLine, QT_TRANSLATE_NOOP("HalfAnglesPlot", "facing right")),
    "bottom": (OKABE_ITO["green"], Qt.PenStyle.DotLine, QT_TRANSLATE_NOOP("HalfAnglesPlot", "facing bottom")),
    "top": (OKABE_ITO["purple"], Qt.PenStyle.DashDotLine, QT_TRANSLATE_NOOP("HalfAnglesPlot", "facing top")),
}

_HEADROOM = 1.6

_ALL = (128, 128, 128, 90)


class HalfAnglesPlot(Plot):
    """Views a bin of half angles: grey for all slopes, lines for those that face one way, red for what is wanted."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName(self.tr("Half angles that the views reach"))
        self.setMouseEnabled(x=False, y=False)
        self.setLabel("bottom", self.tr("half angle, deg"))
        self.setLabel("left", self.tr("views in 5 deg"))
        self.getPlotItem().addLegend(offset=(-1, 1), labelTextSize="8pt", colCount=2)

    def show_coverage(self, reached: Coverage | None) -> None:
        """Show what the views reach; nothing where it is not known."""
        self.clear()
        if reached is None:
            return
        self.plot(reached.edges_deg, reached.all_over, stepMode="center", fillLevel=0.0, brush=_ALL, pen=None)
        for name, views in reached.slopes.items():
            if name in _SLOPES:
                colour, style, text = _SLOPES[name]
                told = QCoreApplication.translate("HalfAnglesPlot", text)
                pen = pg.mkPen(colour, width=2, style=style)
                self.plot(reached.edges_deg, views, stepMode="center", pen=pen, name=told)
        wanted = np.array(
            [[0.0, MIN_VIEWS_FIRST], [BIN_DEG, MIN_VIEWS_FIRST], [BIN_DEG, MIN_VIEWS], [JUDGED_TO_DEG, MIN_VIEWS]]
        )
        self.plot(*wanted.T, connect="pairs", pen=pg.mkPen(OKABE_ITO["vermillion"], width=2))
        # Room above for the legend.
        highest = max(float(np.max(views)) for views in (reached.all_over, *reached.slopes.values()))
        self.setRange(xRange=(0.0, 90.0), yRange=(0.0, _HEADROOM * max(highest, MIN_VIEWS)), padding=0.02)
