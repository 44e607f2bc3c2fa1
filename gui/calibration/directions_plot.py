"""From where the camera looked at the sample: each pose a dot by azimuth and tilt, one of them picked."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QKeyEvent
from PySide6.QtWidgets import QWidget

from analysis.reporting.calibration_file import SavedView
from gui.widgets.plots import OKABE_ITO, Plot

RING_DEG = 15

_MIN_RINGS = 3

_STEPS = {Qt.Key.Key_Left: -1, Qt.Key.Key_Up: -1, Qt.Key.Key_Right: 1, Qt.Key.Key_Down: 1}

_GRID = (128, 128, 128, 110)


class DirectionsPlot(Plot):
    """The hemisphere over the sample, from above; rings are tilts. A click or the arrow keys pick a pose."""

    picked = Signal(int)  # number of the view

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.setAccessibleName(self.tr("Directions of the camera over the sample"))
        self.setAspectLocked(True)
        self.setMouseEnabled(x=False, y=False)
        for side in ("left", "bottom"):
            self.getPlotItem().hideAxis(side)
        self._rings: list[pg.GraphicsObject] = []
        self.dots = pg.ScatterPlotItem(size=10, pen=None, brush=pg.mkBrush(OKABE_ITO["blue"]), hoverable=True)
        # Told apart by its shape and size too.
        mark = pg.mkPen(OKABE_ITO["vermillion"], width=3)
        self.mark = pg.ScatterPlotItem(size=20, symbol="d", pen=mark, brush=None)
        self.addItem(self.dots)
        self.addItem(self.mark)
        self.dots.sigClicked.connect(lambda _, dots: self.picked.emit(int(dots[0].index())))
        self._places: NDArray[np.float64] = np.zeros((0, 2))
        self._picked: int | None = None

    def show_views(self, views: Sequence[SavedView]) -> None:
        """Show where the camera stood in each view."""
        tilt, azimuth = (np.array([getattr(view, name) for view in views]) for name in ("tilt", "azimuth"))
        self._places = np.rad2deg(tilt)[:, None] * np.stack([np.cos(azimuth), np.sin(azimuth)], axis=-1)
        names = [self.tr("pose {pose}, tilt {tilt:.0f} deg") for _ in views]
        tips = [n.format(pose=v.i_pose, tilt=np.rad2deg(v.tilt)) for n, v in zip(names, views, strict=True)]
        self.dots.setData(pos=self._places, data=tips, tip=lambda x, y, data: data)
        n_rings = max(int(np.ceil(np.rad2deg(tilt.max(initial=0.0)) / RING_DEG)), _MIN_RINGS)
        self._draw_rings(n_rings)
        self.pick(None)

    def pick(self, view: int | None) -> None:
        """Mark a view, or none."""
        self._picked = view
        self.mark.setData(pos=self._places[[] if view is None else [view]].reshape(-1, 2))

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Pick the pose before or after; Qt calls this."""
        step, n = _STEPS.get(Qt.Key(event.key())), len(self._places)
        if step is None or n == 0:
            super().keyPressEvent(event)
            return
        start = (-1 if step > 0 else n) if self._picked is None else self._picked
        self.picked.emit(min(max(start + step, 0), n - 1))

    def _draw_rings(self, n_rings: int) -> None:
        for item in self._rings:
            self.removeItem(item)
        widest, pen = n_rings * RING_DEG, pg.mkPen(_GRID)
        turn = np.linspace(0.0, 2.0 * np.pi, 121)
        radii = [RING_DEG * (i + 1) for i in range(n_rings)]
        self._rings = [pg.PlotCurveItem(r * np.cos(turn), r * np.sin(turn), pen=pen) for r in radii]
        self._rings += [pg.PlotCurveItem([-widest, widest], [0, 0], pen=pen)]
        self._rings += [pg.PlotCurveItem([0, 0], [-widest, widest], pen=pen)]
        for radius in radii:
            label = pg.TextItem(f"{radius}°", color=_GRID[:3], anchor=(0.5, 0.5))
            label.setPos(radius * np.sqrt(0.5), -radius * np.sqrt(0.5))
            self._rings.append(label)
        for item in self._rings:
            item.setZValue(-1)
            self.addItem(item)
        self.setRange(xRange=(-widest, widest), yRange=(-widest, widest), padding=0.05)
