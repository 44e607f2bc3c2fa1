"""What is left of the boards' corners, as arrows over the picture: all views, one of them brought out."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import QWidget

from analysis.camera.residual_arrows import exaggeration, rounded_down
from analysis.reporting.calibration_file import SavedView
from gui.widgets.plots import OKABE_ITO, Plot

Array = NDArray[np.float64]

_OTHERS = (128, 128, 128, 110)

_SCALE_SHARE = 0.15  # of the width, that the scale may take

_HEAD = 0.25  # of an arrow's length


class ResidualsPlot(Plot):
    """The picture's frame with an arrow for each corner, found less predicted; a click picks the nearest one's view."""

    picked = Signal(int)  # number of the view

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setAccessibleName(self.tr("Residuals of the corners over the picture"))
        self.setAspectLocked(True)
        self.invertY(True)
        self.setLabel("bottom", self.tr("column, pixels"))
        self.setLabel("left", self.tr("row, pixels"))
        self.frame_item = pg.PlotCurveItem(pen=pg.mkPen(_OTHERS))
        self.others = pg.PlotCurveItem(connect="pairs", pen=pg.mkPen(_OTHERS))
        self.arrows = pg.PlotCurveItem(connect="pairs")
        self.scale = pg.PlotCurveItem(connect="pairs", pen=pg.mkPen(OKABE_ITO["blue"], width=3))
        self.scale_text = pg.TextItem(color=_OTHERS[:3], anchor=(0.0, 1.0))
        for item in (self.frame_item, self.others, self.arrows, self.scale, self.scale_text):
            self.addItem(item, ignoreBounds=item is self.scale_text)
        self._views: Sequence[SavedView] = ()
        self._image_size = (1, 1)
        self.times = 1.0
        self.getPlotItem().scene().sigMouseClicked.connect(self._clicked)

    def show_views(self, views: Sequence[SavedView], image_size: tuple[int, int]) -> None:
        """Show all views, in a picture of that width and height."""
        self._views, self._image_size = views, image_size
        width, height = image_size
        corners = np.array([[0, 0], [width, 0], [width, height], [0, height], [0, 0]]) - 0.5
        self.frame_item.setData(*corners.T)
        self.setRange(xRange=(0, width), yRange=(0, height), padding=0.03)
        self.pick(None)

    def pick(self, view: int | None) -> None:
        """Bring out the arrows of a view over the others, or show all alike."""
        shown = [self._views[view]] if view is not None else list(self._views)
        residuals = np.concatenate([np.zeros((0, 2)), *(v.residuals for v in shown)])
        self.times = exaggeration(residuals, self._image_size)
        # Thin where there are tens of thousands, which are drawn much faster so.
        self.arrows.setPen(pg.mkPen(OKABE_ITO["vermillion"], width=1 if view is None else 2))
        self._draw(self.arrows, shown)
        self._draw(self.others, [] if view is None else list(self._views))
        self._draw_scale(bool(len(residuals)))

    def _draw(self, item: pg.PlotCurveItem, views: Sequence[SavedView]) -> None:
        corners, residuals = (
            np.concatenate([np.zeros((0, 2)), *(getattr(view, name) for view in views)])
            for name in ("corners", "residuals")
        )
        item.setData(*_arrows(corners, self.times * residuals).T)

    def _draw_scale(self, is_shown: bool) -> None:
        width, height = self._image_size
        length = rounded_down(_SCALE_SHARE * width / self.times)
        start = np.array([[0.03 * width, 0.95 * height]])
        self.scale.setData(*_arrows(start, np.array([[length * self.times, 0.0]])).T)
        self.scale_text.setText(f"{length:g} px")
        self.scale_text.setPos(*start[0])
        for item in (self.scale, self.scale_text):
            item.setVisible(is_shown)

    def _clicked(self, event: pg.GraphicsScene.mouseEvents.MouseClickEvent) -> None:
        if event.button() != Qt.MouseButton.LeftButton or not self._views:
            return
        point = self.getPlotItem().vb.mapSceneToView(event.scenePos())
        at = np.array([point.x(), point.y()])
        away = [np.min(np.linalg.norm(v.corners - at, axis=1), initial=np.inf) for v in self._views]
        self.picked.emit(int(np.argmin(away)))


def _arrows(start: Array, along: Array) -> Array:
    """Return the ends of the lines of arrows, two and two, shape (6 n, 2)."""
    tip, side = start + along, np.stack([-along[:, 1], along[:, 0]], axis=1)
    back = [tip - _HEAD * (along + sign * 0.5 * side) for sign in (-1.0, 1.0)]
    return np.stack([start, tip, back[0], tip, back[1], tip], axis=1).reshape(-1, 2)
