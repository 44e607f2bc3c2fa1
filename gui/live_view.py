"""The live picture: raw counts at full bit depth, clipped pixels in red."""

from __future__ import annotations

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtWidgets import QCheckBox, QHBoxLayout, QLabel, QVBoxLayout, QWidget

from drivers.camera import CameraDescription

ZEBRA_RGBA = (255, 0, 0, 255)


class LiveView(QWidget):
    """Shows frames of one camera; wheel to zoom, drag to pan."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._saturation_level = np.inf
        self.canvas = pg.GraphicsView()
        self._box = pg.ViewBox(lockAspect=True, invertY=True, enableMenu=False)
        # Rows first, as in numpy: pyqtgraph's own default shows pictures transposed.
        self.picture = pg.ImageItem(axisOrder="row-major")
        self.zebra = pg.ImageItem(axisOrder="row-major")
        self.canvas.setCentralItem(self._box)
        self._box.addItem(self.picture)
        self._box.addItem(self.zebra)
        self.zebra_switch = QCheckBox("Mark clipped pixels in red")
        self.zebra_switch.setChecked(True)
        self.zebra_switch.toggled.connect(self.zebra.setVisible)
        self.counts_label = QLabel("no frame yet")
        self._lay_out()

    def expect(self, camera: CameraDescription) -> None:
        """Take levels and clipping from `camera`, and fit the view to its frames."""
        self._saturation_level = camera.saturation_level
        self.picture.setLevels((camera.black_level, camera.saturation_level))
        self._box.setRange(xRange=(0, camera.width), yRange=(0, camera.height), padding=0.02)

    def show_counts(self, counts: NDArray[np.uint16]) -> None:
        """Show one raw frame, shape (height, width)."""
        clipped = counts >= self._saturation_level
        self.picture.setImage(counts, autoLevels=False)
        self.zebra.setImage(_overlay(clipped), autoLevels=False, levels=(0, 255))
        self.counts_label.setText(
            f"counts {counts.min()} to {counts.max()}, median {np.median(counts):.0f}; "
            f"{np.count_nonzero(clipped)} of {counts.size} pixels clipped"
        )

    def _lay_out(self) -> None:
        below = QHBoxLayout()
        below.addWidget(self.zebra_switch)
        below.addStretch()
        below.addWidget(self.counts_label)
        layout = QVBoxLayout(self)
        layout.setContentsMargins(0, 0, 0, 0)
        layout.addWidget(self.canvas, stretch=1)
        layout.addLayout(below)


def _overlay(clipped: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """Return an RGBA picture, shape (height, width, 4): red where `clipped`, else see-through."""
    rgba = np.zeros((*clipped.shape, 4), dtype=np.uint8)
    rgba[clipped] = ZEBRA_RGBA
    return rgba
