"""Plots and pictures in the colours of the window, and a cursor that keys move as well as the mouse."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QEvent, QPointF, Qt, Signal
from PySide6.QtGui import QKeyEvent, QPalette
from PySide6.QtWidgets import QWidget

OKABE_ITO = {
    "orange": "#e69f00",
    "sky blue": "#56b4e9",
    "green": "#009e73",
    "yellow": "#f0e442",
    "blue": "#0072b2",
    "vermillion": "#d55e00",
    "purple": "#cc79a7",
}
"""Colours that any kind of sight tells apart [okabe2008]."""

CHANNEL_COLOURS = {
    "R": OKABE_ITO["vermillion"],
    "G": OKABE_ITO["green"],
    "B": OKABE_ITO["blue"],
    "grey": "#808080",
}

_STEPS = {Qt.Key.Key_Up: (-1, 0), Qt.Key.Key_Down: (1, 0), Qt.Key.Key_Left: (0, -1), Qt.Key.Key_Right: (0, 1)}

_LARGE_STEP = 10  # with Shift

_ZOOM = {Qt.Key.Key_Plus: 0.8, Qt.Key.Key_Equal: 0.8, Qt.Key.Key_Minus: 1.25}


class Plot(pg.PlotWidget):  # type: ignore[misc]  # pyqtgraph states no types
    """A plot in the colours of the window."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setMenuEnabled(False)
        self._colour()

    def changeEvent(self, event: QEvent) -> None:
        """Follow the palette; Qt calls this."""
        super().changeEvent(event)
        # The first such event comes before there is anything to colour.
        if event.type() == QEvent.Type.PaletteChange and self.getPlotItem() is not None:
            self._colour()

    def _colour(self) -> None:
        self.setBackground(self.palette().color(QPalette.ColorRole.Base))
        text = self.palette().color(QPalette.ColorRole.Text)
        for name in ("left", "bottom"):
            axis = self.getPlotItem().getAxis(name)
            axis.setPen(text)
            axis.setTextPen(text)


class Picture(pg.GraphicsView):  # type: ignore[misc]  # as above
    """A picture with square pixels, first row on top.

    Wheel, + and - zoom, dragging pans, 0 shows the whole; arrow keys move the cursor (with Shift by ten pixels), and a
    click or Enter picks a pixel.
    """

    pointed = Signal(int, int)  # row, column
    picked = Signal(int, int)  # row, column

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.box = pg.ViewBox(lockAspect=True, invertY=True, enableMenu=False)
        self.setCentralItem(self.box)
        # Rows first, as in numpy: pyqtgraph's own default shows pictures transposed.
        self.item = pg.ImageItem(axisOrder="row-major")
        self.cursor_item = pg.TargetItem(movable=False, size=14, pen=pg.mkPen(OKABE_ITO["vermillion"], width=2))
        self.cursor_item.setVisible(False)
        self.cursor_item.setZValue(10)
        self.box.addItem(self.item)
        self.box.addItem(self.cursor_item)
        self._size = (0, 0)
        self._cursor = (0, 0)
        scene = self.box.scene()
        scene.sigMouseMoved.connect(self._moved)
        scene.sigMouseClicked.connect(self._clicked)
        self._colour()

    @property
    def size_in_pixels(self) -> tuple[int, int]:
        """Height and width of what is shown."""
        return self._size

    @property
    def pixels_per_dot(self) -> float:
        """How many pixels of the picture fall on one dot of the screen, in each direction."""
        width, _ = self.box.viewPixelSize()
        return float(width / self.devicePixelRatioF())

    def show_image(
        self,
        image: NDArray[np.uint8],
        table: NDArray[np.uint8] | None = None,
        step: int = 1,
        size: tuple[int, int] | None = None,
    ) -> None:
        """Show a picture, shape (H, W) or (H, W, 3); one of another size than before is shown whole.

        Parameters
        ----------
        image : ndarray of uint8
        table : ndarray of uint8, shape (256, 3) or (256, 4), optional
            Colours of the values of a picture of shape (H, W); grey by default.
        step : int, optional
            Each of its pixels stands for so many of the picture, in each direction.
        size : tuple of int, optional
            Height and width of the picture; by default `step` times those of `image`.
        """
        height, width = (step * n for n in image.shape[:2])
        self.item.setImage(image, autoLevels=False, lut=table, levels=(0, 255))
        self.item.setRect(0, 0, width, height)
        if (size or (height, width)) != self._size:
            self.fit(*(size or (height, width)))

    def fit(self, height: int, width: int) -> None:
        """Show the whole of a picture of that size."""
        self._size = (height, width)
        self.box.setRange(xRange=(0, width), yRange=(0, height), padding=0.02)

    def set_cursor(self, row: int, column: int) -> None:
        """Move the cursor to a pixel of the picture, or the nearest that there is; tell of it."""
        height, width = self._size
        if height == 0:
            return
        self._cursor = (min(max(row, 0), height - 1), min(max(column, 0), width - 1))
        self.cursor_item.setPos(self._cursor[1] + 0.5, self._cursor[0] + 0.5)
        self.cursor_item.setVisible(True)
        self.pointed.emit(*self._cursor)

    def place_of(self, position: QPointF) -> tuple[float, float]:
        """Return the row and column, pixel centres at halves, of a place in the scene."""
        point = self.box.mapSceneToView(position)
        return point.y(), point.x()

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Move the cursor, zoom or pick; Qt calls this."""
        key = Qt.Key(event.key())
        if key in _STEPS:
            step = _LARGE_STEP if event.modifiers() & Qt.KeyboardModifier.ShiftModifier else 1
            self.set_cursor(*(c + step * s for c, s in zip(self._cursor, _STEPS[key], strict=True)))
        elif key in _ZOOM:
            self.box.scaleBy((_ZOOM[key],) * 2)
        elif key == Qt.Key.Key_0:
            self.fit(*self._size)
        elif key in (Qt.Key.Key_Return, Qt.Key.Key_Enter) and self._size[0]:
            self.picked.emit(*self._cursor)
        else:
            super().keyPressEvent(event)

    def changeEvent(self, event: QEvent) -> None:
        """Follow the palette; Qt calls this."""
        super().changeEvent(event)
        if event.type() == QEvent.Type.PaletteChange:
            self._colour()

    def _colour(self) -> None:
        self.setBackground(self.palette().color(QPalette.ColorRole.Base))

    def _pixel(self, position: QPointF) -> tuple[int, int] | None:
        row, column = (int(np.floor(c)) for c in self.place_of(position))
        inside = 0 <= row < self._size[0] and 0 <= column < self._size[1]
        return (row, column) if inside else None

    def _moved(self, position: QPointF) -> None:
        pixel = self._pixel(position)
        if pixel is not None:
            self.pointed.emit(*pixel)

    def _clicked(self, event: pg.GraphicsScene.mouseEvents.MouseClickEvent) -> None:
        pixel = self._pixel(event.scenePos())
        if pixel is not None and event.button() == Qt.MouseButton.LeftButton:
            self.set_cursor(*pixel)
            self.picked.emit(*pixel)
