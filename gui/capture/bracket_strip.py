"""The frames of the last pose in small, each with its exposure time and how much of it clips."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QRect, QSize, Qt
from PySide6.QtGui import QImage, QPainter, QPaintEvent
from PySide6.QtWidgets import QGridLayout, QSizePolicy, QVBoxLayout, QWidget

from gui.widgets.text import selectable
from protocols.capture.progress import PoseTaken

MS = 1e-3

N_COLUMNS = 3


class Thumbnail(QWidget):
    """One grey picture as large as there is room."""

    def __init__(self, grey: NDArray[np.uint8], parent: QWidget | None = None) -> None:
        super().__init__(parent)
        height, width = grey.shape
        # The copy is Qt's own, so that the array may go.
        self.image = QImage(grey.tobytes(), width, height, width, QImage.Format.Format_Grayscale8).copy()
        policy = QSizePolicy(QSizePolicy.Policy.Expanding, QSizePolicy.Policy.Preferred)
        policy.setHeightForWidth(True)
        self.setSizePolicy(policy)

    def hasHeightForWidth(self) -> bool:
        """Keep the shape of the picture; Qt calls this."""
        return True

    def heightForWidth(self, width: int) -> int:
        """Return the height that keeps the shape of the picture; Qt calls this."""
        return int(width * self.image.height() // self.image.width())

    def sizeHint(self) -> QSize:
        """Return a size that lets the frames of most brackets stand beside each other; Qt calls this."""
        width = 6 * self.fontMetrics().height()
        return QSize(width, self.heightForWidth(width))

    def paintEvent(self, event: QPaintEvent) -> None:
        """Draw the picture in the middle; Qt calls this."""
        size = self.image.size().scaled(self.size(), Qt.AspectRatioMode.KeepAspectRatio)
        place = QRect(0, 0, size.width(), size.height())
        place.moveCenter(self.rect().center())
        painter = QPainter(self)
        painter.setRenderHint(QPainter.RenderHint.SmoothPixmapTransform)
        painter.drawImage(place, self.image)


class BracketStrip(QWidget):
    """Shows the bracket of one pose; hidden before the first."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.title_label = selectable()
        self._grid = QGridLayout()
        for i in range(N_COLUMNS):
            self._grid.setColumnStretch(i, 1)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addWidget(self.title_label)
        column.addLayout(self._grid)
        self.hide()

    def show_pose(self, taken: PoseTaken) -> None:
        """Show the bracket of a pose, exposure times ascending."""
        while (item := self._grid.takeAt(0)) is not None:
            if (old := item.widget()) is not None:
                old.deleteLater()
        self.title_label.setText(self.tr("Frames of pose {number}").format(number=taken.i_pose + 1))
        frames = zip(taken.thumbnails, taken.exposure_times, taken.clipped, strict=True)
        for i, (grey, exposure_time, clipped) in enumerate(frames):
            text = self.tr("{time} ms\n{share} % clipped").format(
                time=f"{exposure_time / MS:.4g}", share=_percent(float(clipped))
            )
            row, column = divmod(i, N_COLUMNS)
            thumbnail = Thumbnail(grey)
            thumbnail.setAccessibleName(text)
            self._grid.addWidget(thumbnail, 2 * row, column)
            self._grid.addWidget(selectable(text), 2 * row + 1, column)
        self.show()


def _percent(share: float) -> str:
    """Return a share in percent; what is not 0 never reads as 0."""
    percent = 100.0 * share
    return "< 0.1" if 0.0 < percent < 0.1 else f"{percent:.3g}"
