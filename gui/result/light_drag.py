"""The light over a picture, moved by dragging it or by the arrow keys."""

from __future__ import annotations

import pyqtgraph as pg
from PySide6.QtCore import QEvent, QObject, QPointF, Qt, Signal
from PySide6.QtGui import QKeyEvent, QMouseEvent

from gui.widgets.plots import OKABE_ITO, Picture

STEP = 0.1
"""By which an arrow key moves it."""

FARTHEST = 2.0
"""From the centre, in half widths of the picture."""

_STEPS = {Qt.Key.Key_Up: (0, 1), Qt.Key.Key_Down: (0, -1), Qt.Key.Key_Left: (-1, 0), Qt.Key.Key_Right: (1, 0)}


class LightDrag(QObject):
    """Takes the mouse and the arrow keys of a picture while it is on.

    Parameters
    ----------
    picture : Picture
    """

    moved = Signal(float, float)  # from -1 to 1 across the picture and up

    def __init__(self, picture: Picture) -> None:
        super().__init__(picture)
        self._picture = picture
        self._is_on = False
        self.place = (-0.5, 0.5)
        self.sign = pg.ScatterPlotItem(size=22, symbol="star", brush=OKABE_ITO["yellow"], pen=pg.mkPen("k"))
        self.sign.setZValue(20)
        self.sign.hide()
        picture.box.addItem(self.sign, ignoreBounds=True)
        picture.installEventFilter(self)
        picture.viewport().installEventFilter(self)

    def switch_to(self, *, on: bool) -> None:
        """Take the mouse and the keys, or leave them to the picture."""
        self._is_on = on
        self.sign.setVisible(on)
        self._picture.box.setMouseEnabled(x=not on, y=not on)
        if on:
            self.move_to(*self.place)

    def move_to(self, x: float, y: float) -> None:
        """Put the light over a place, and tell of it."""
        x, y = (min(max(value, -FARTHEST), FARTHEST) for value in (x, y))
        self.place = (x, y)
        height, width = self._picture.size_in_pixels
        self.sign.setData(pos=[(0.5 * (1.0 + x) * width, 0.5 * (1.0 - y) * height)])
        self.moved.emit(x, y)

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        """Take arrow keys and drags; Qt calls this."""
        if not self._is_on:
            return super().eventFilter(watched, event)
        if event.type() == QEvent.Type.KeyPress and isinstance(event, QKeyEvent) and event.key() in _STEPS:
            right, up = _STEPS[Qt.Key(event.key())]
            self.move_to(self.place[0] + STEP * right, self.place[1] + STEP * up)
            return True
        if isinstance(event, QMouseEvent) and _is_drag(event):
            self._drag_to(event.position())
            return True
        return super().eventFilter(watched, event)

    def _drag_to(self, position: QPointF) -> None:
        height, width = self._picture.size_in_pixels
        row, column = self._picture.place_of(self._picture.mapToScene(position.toPoint()))
        if height and width:
            self.move_to(2.0 * column / width - 1.0, 1.0 - 2.0 * row / height)


def _is_drag(event: QMouseEvent) -> bool:
    return event.type() == QEvent.Type.MouseMove and bool(event.buttons() & Qt.MouseButton.LeftButton)
