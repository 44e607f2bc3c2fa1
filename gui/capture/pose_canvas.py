"""Draws the places of the lens over the sample, by parallel rays; the mouse or the arrow keys turn it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, QRectF, QSize, Qt, Signal
from PySide6.QtGui import QKeyEvent, QMouseEvent, QPainter, QPaintEvent, QPalette, QPen, QPolygonF
from PySide6.QtWidgets import QWidget

from gui.capture.pose_signs import draw_sign
from gui.capture.poses import PoseState

Array = NDArray[np.float64]

RINGS_DEG = (30.0, 60.0)

STEP_DEG, DEG_PER_PIXEL = 10.0, 0.5

_TURNS = {Qt.Key.Key_Left: (-1, 0), Qt.Key.Key_Right: (1, 0), Qt.Key.Key_Up: (0, 1), Qt.Key.Key_Down: (0, -1)}

_CHOICES = {Qt.Key.Key_PageUp: -1, Qt.Key.Key_PageDown: 1}

_PLATE = 0.45  # half the longer side of the plate, as a share of the distance to the lens: larger than it is

_MARGIN = 1.15  # what is around the hemisphere

_CIRCLE = np.deg2rad(np.arange(0.0, 361.0, 5.0))


class PoseCanvas(QWidget):
    """Poses on a hemisphere over the plate, seen from aside and above."""

    chosen = Signal(int)  # a pose, by mouse or by Page up and Page down

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.setFocusPolicy(Qt.FocusPolicy.StrongFocus)
        self.turn_deg, self.height_deg = -60.0, 50.0
        self._sides = np.zeros((0, 3))
        self._states: Sequence[PoseState] = ()
        self._plate = (_PLATE, _PLATE)
        self._named: int | None = None
        self._dragged_from: QPointF | None = None

    def sizeHint(self) -> QSize:
        """Return a size at which poses can be told apart; Qt calls this."""
        return QSize(12, 12) * self.fontMetrics().height()

    def minimumSizeHint(self) -> QSize:
        """Return the smallest size; Qt calls this."""
        return QSize(8, 8) * self.fontMetrics().height()

    def show_poses(self, lens: Array, states: Sequence[PoseState], area_mm: tuple[float, float]) -> None:
        """Show places of the lens, shape (P, 3), sample frame, with the state of each pose, over a plate, mm."""
        self._sides = lens / np.linalg.norm(lens, axis=1, keepdims=True)
        self._states = tuple(states)
        self._plate = (_PLATE * area_mm[0] / max(area_mm), _PLATE * area_mm[1] / max(area_mm))
        self.update()

    def name_pose(self, i_pose: int | None) -> None:
        """Draw a ring about one pose."""
        self._named = i_pose
        self.update()

    def at(self, points: Array) -> Array:
        """Return where points (..., 3) of the unit hemisphere are drawn, shape (..., 2), pixels of this widget."""
        turn, height = np.deg2rad([self.turn_deg, self.height_deg])
        across = np.array([-np.sin(turn), np.cos(turn), 0.0])
        up = np.array([-np.sin(height) * np.cos(turn), -np.sin(height) * np.sin(turn), np.cos(height)])
        seen = np.stack([points @ across, points @ up], axis=-1)
        # The hemisphere reaches from the near edge of its rim to its top, or to the far edge.
        low, high = -np.sin(height), 1.0
        scale = min(self.width() / (2.0 * _MARGIN), self.height() / (_MARGIN * (high - low)))
        middle = np.array([self.width() / 2, self.height() / 2 + scale * (low + high) / 2])
        return np.asarray(middle + scale * seen * [1.0, -1.0])

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw; Qt calls this."""
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.Antialiasing)
        painter.fillRect(self.rect(), self.palette().color(QPalette.ColorRole.Base))
        self._draw_plate(painter)
        self._draw_rings(painter)
        places = self.at(self._sides)
        # The current one is drawn last, over all others.
        for i in sorted(range(len(self._states)), key=lambda i: self._states[i] is PoseState.CURRENT):
            draw_sign(painter, QPointF(*places[i]), self._radius, self._states[i])
        if self._named is not None and self._named < len(places):
            painter.setPen(QPen(self.palette().color(QPalette.ColorRole.Text), 1.5))
            painter.setBrush(Qt.BrushStyle.NoBrush)
            painter.drawEllipse(QPointF(*places[self._named]), 2.0 * self._radius, 2.0 * self._radius)

    def keyPressEvent(self, event: QKeyEvent) -> None:
        """Turn, or choose a pose; Qt calls this."""
        key = Qt.Key(event.key())
        if key in _TURNS:
            self._turn(*(STEP_DEG * part for part in _TURNS[key]))
        elif key in _CHOICES and self._states:
            before = -1 if self._named is None else self._named
            self.chosen.emit((before + _CHOICES[key]) % len(self._states))
        else:
            super().keyPressEvent(event)

    def mousePressEvent(self, event: QMouseEvent) -> None:
        """Begin to drag, and choose the pose under the mouse; Qt calls this."""
        self._dragged_from = event.position()
        place = np.array([event.position().x(), event.position().y()])
        far = np.linalg.norm(self.at(self._sides) - place, axis=-1)
        if far.size and far.min() < 2.0 * self._radius:
            self.chosen.emit(int(np.argmin(far)))

    def mouseMoveEvent(self, event: QMouseEvent) -> None:
        """Turn with the mouse; Qt calls this."""
        if self._dragged_from is not None:
            way = event.position() - self._dragged_from
            self._dragged_from = event.position()
            self._turn(-DEG_PER_PIXEL * way.x(), DEG_PER_PIXEL * way.y())

    def _turn(self, turn_deg: float, height_deg: float) -> None:
        self.turn_deg = (self.turn_deg + turn_deg + 180.0) % 360.0 - 180.0
        self.height_deg = min(max(self.height_deg + height_deg, 0.0), 90.0)
        self.update()

    @property
    def _radius(self) -> float:
        return 0.3 * self.fontMetrics().height()

    def _pen(self, width: float = 1.0) -> QPen:
        return QPen(self.palette().color(QPalette.ColorRole.PlaceholderText), width)

    def _draw_plate(self, painter: QPainter) -> None:
        x, y = self._plate
        corners = self.at(np.array([[-x, -y, 0.0], [x, -y, 0.0], [x, y, 0.0], [-x, y, 0.0]]))
        painter.setPen(self._pen(1.5))
        painter.setBrush(self.palette().color(QPalette.ColorRole.AlternateBase))
        painter.drawPolygon(QPolygonF([QPointF(*corner) for corner in corners]))
        # Axes of the sample: azimuth 0 is along x, 90 along y.
        for text, end in (("x", [1.3 * x, 0.0, 0.0]), ("y", [0.0, 1.3 * y, 0.0])):
            self._draw_text(painter, self.at(np.array(end)), text)

    def _draw_rings(self, painter: QPainter) -> None:
        painter.setBrush(Qt.BrushStyle.NoBrush)
        for tilt_deg in (*RINGS_DEG, 90.0):
            tilt = np.deg2rad(tilt_deg)
            ring = [np.sin(tilt) * np.cos(_CIRCLE), np.sin(tilt) * np.sin(_CIRCLE), np.full_like(_CIRCLE, np.cos(tilt))]
            places = self.at(np.stack(ring, axis=-1))
            painter.setPen(self._pen())
            painter.drawPolyline(QPolygonF([QPointF(*place) for place in places]))
            if tilt_deg in RINGS_DEG:
                self._draw_text(painter, places[np.argmax(places[:, 0])], f"{tilt_deg:.0f}°")

    def _draw_text(self, painter: QPainter, place: Array, text: str) -> None:
        painter.setPen(self.palette().color(QPalette.ColorRole.Text))
        size = 2.0 * self.fontMetrics().height()
        painter.drawText(
            QRectF(place[0] - size / 2, place[1] - size / 2, size, size), Qt.AlignmentFlag.AlignCenter, text
        )
