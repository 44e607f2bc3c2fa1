"""How the state of a pose is drawn: each has a colour and a shape."""

from __future__ import annotations

from PySide6.QtCore import QPointF, Qt
from PySide6.QtGui import QColor, QPainter, QPainterPath, QPen, QPolygonF

from gui.capture.poses import PoseState
from gui.widgets.plots import OKABE_ITO

COLOURS = {
    PoseState.PLANNED: OKABE_ITO["sky blue"],
    PoseState.CURRENT: OKABE_ITO["orange"],
    PoseState.COMPLETE: OKABE_ITO["green"],
    PoseState.MISSED: OKABE_ITO["vermillion"],
}

SIGNS = {PoseState.PLANNED: "○", PoseState.CURRENT: "◆", PoseState.COMPLETE: "●", PoseState.MISSED: "✕"}
"""The shapes in a text."""

_FILLED = (PoseState.COMPLETE, PoseState.CURRENT)

_CORNERS = ((0.0, -1.0), (1.0, 0.0), (0.0, 1.0), (-1.0, 0.0))

_STROKES = (((-1.0, -1.0), (1.0, 1.0)), ((-1.0, 1.0), (1.0, -1.0)))


def draw_sign(painter: QPainter, place: QPointF, radius: float, state: PoseState) -> None:
    """Draw the sign of a pose at a place of what is painted on; `radius` in its pixels."""
    colour, filled = QColor(COLOURS[state]), state in _FILLED
    painter.setPen(QPen(colour, 1.0 if filled else 2.0))
    painter.setBrush(colour if filled else Qt.BrushStyle.NoBrush)
    painter.drawPath(_shape(place, radius, state))


def _shape(place: QPointF, radius: float, state: PoseState) -> QPainterPath:
    path = QPainterPath()
    if state is PoseState.CURRENT:
        path.addPolygon(QPolygonF([place + QPointF(*corner) * 1.6 * radius for corner in _CORNERS]))
        path.closeSubpath()
    elif state is PoseState.MISSED:
        for begin, end in _STROKES:
            path.moveTo(place + QPointF(*begin) * radius)
            path.lineTo(place + QPointF(*end) * radius)
    else:
        path.addEllipse(place, radius, radius)
    return path
