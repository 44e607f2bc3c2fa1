"""A result: its maps, the curve at a point that is picked, and the sample relit where the mouse drags the light."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pyqtgraph as pg
from numpy.typing import NDArray
from PySide6.QtCore import QPointF, Qt, Signal
from PySide6.QtWidgets import QComboBox, QFileDialog, QHBoxLayout, QLabel, QLineEdit, QPushButton, QVBoxLayout, QWidget

from analysis.figures import display_colours, normal_colours
from analysis.materials import group_materials
from analysis.reflectance import Cosines
from analysis.result import Result, diffuse_albedo, read_result
from gui.job import Job
from gui.newest import Newest
from gui.plots import CHANNEL_COLOURS

Array = NDArray[np.float64]

RELIT = "Relit (drag the light)"
_ANGLES = np.deg2rad(np.linspace(0.0, 85.0, 200))
_LIGHT_HEIGHT = 0.8  # of the light that is dragged, in widths of the area


def _scalar(values: Array) -> Array:
    low, high = np.nanpercentile(values, [1, 99]) if np.isfinite(values).any() else (0.0, 1.0)
    scaled = np.clip((values - low) / max(high - low, 1e-12), 0.0, 1.0)
    table = pg.colormap.get("viridis").getLookupTable(nPts=256, alpha=False)
    colours = table[np.nan_to_num(scaled * 255.0).astype(int)] / 255.0
    return np.asarray(np.where(np.isfinite(values)[..., None], colours, 0.0))


MAPS: dict[str, Callable[[Result], Array]] = {
    "Normals": lambda result: normal_colours(result.normals),
    "Depth": lambda result: _scalar(result.depth),
    "Albedo": lambda result: display_colours(result.as_map(diffuse_albedo(result.fits))),
    "Materials": lambda result: _scalar(result.as_map(group_materials(result.fits)).astype(float)),
    "Sigma of the normals": lambda result: _scalar(result.as_map(result.fits.normal_sigma)),
    "Residual": lambda result: _scalar(np.sqrt(result.as_map(result.fits.reduced_chi2))),
}
"""Colours, shape (H, W, 3) and 0 to 1, by what the operator reads."""


class ResultTab(QWidget):
    """Shows a result file; reads it in a thread of its own."""

    shown = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.file_edit = QLineEdit(placeholderText="sample.result.h5")
        self.open_button = QPushButton("&Open")
        self.map_box = QComboBox()
        self.map_box.addItems([*MAPS, RELIT])
        self.canvas = pg.GraphicsView()
        self._box = pg.ViewBox(lockAspect=True, invertY=True, enableMenu=False)
        self.picture = pg.ImageItem(axisOrder="row-major")
        self.canvas.setCentralItem(self._box)
        self._box.addItem(self.picture)
        self.curve = pg.PlotWidget()
        self.point_label = QLabel("click into the map to see the curve of a point")
        self._result: Result | None = None
        self._relighting = Newest(_relit, self)
        self._relighting.done.connect(self._set_picture)
        self._job: Job | None = None
        self._lay_out()
        self._wire()

    @property
    def result(self) -> Result | None:
        """What is shown."""
        return self._result

    @property
    def is_busy(self) -> bool:
        """Whether a file is being read."""
        return self._job is not None

    def open_file(self, path: Path) -> None:
        """Read a result and show it; nothing while another one is being read."""
        if self.is_busy:
            return
        self.point_label.setText(f"reading {path}")
        self._job = Job(lambda *_: read_result(path), self)
        self._job.succeeded.connect(self._show)
        self._job.failed.connect(self.point_label.setText)
        self._job.finished.connect(self._end)
        self._job.start()

    def close_job(self) -> None:
        """Wait for what is being read or relit."""
        self._relighting.close()
        if self._job is not None:
            self._job.wait()

    def pick(self, row: int, column: int) -> None:
        """Show the fitted curve of a point, thick where it was seen."""
        result = self._result
        if result is None or not (0 <= row < result.grid.height and 0 <= column < result.grid.width):
            return
        fits = result.fits.select(np.array([row * result.grid.width + column]))
        near, far = fits.theta_h_range[0]
        f = fits.brdf(Cosines.on_slice(_ANGLES[None]))[0]
        seen = (near <= _ANGLES) & (far >= _ANGLES)
        self.curve.clear()
        names = "RGB" if f.shape[1] == 3 else ("grey",)
        for values, name in zip(f.T, names, strict=False):
            for part, width in ((np.ones_like(seen), 1), (seen, 3)):
                pen = pg.mkPen(CHANNEL_COLOURS[name], width=width)
                self.curve.plot(np.rad2deg(_ANGLES[part]), np.maximum(values[part], 1e-6), pen=pen)
        sigma = np.rad2deg(fits.normal_sigma[0])
        self.point_label.setText(
            f"row {row}, column {column}: seen from {np.rad2deg(near):.0f} to {np.rad2deg(far):.0f} deg, "
            f"normal known to {sigma:.2f} deg"
        )

    def relight(self, x: float, y: float) -> None:
        """Show the sample with the light over a point of the area, from -1 to 1 across and up."""
        result = self._result
        if result is None:
            return
        self._relighting.ask((result, x, y))

    def _show(self, result: Result) -> None:
        self._result = result
        self._box.setRange(xRange=(0, result.grid.width), yRange=(0, result.grid.height), padding=0.02)
        self.point_label.setText("click into the map to see the curve of a point")
        self._show_map(self.map_box.currentText())
        self.shown.emit()

    def _end(self) -> None:
        self._job = None

    def _show_map(self, name: str) -> None:
        if self._result is None:
            return
        if name == RELIT:
            self.relight(-0.5, 0.5)
        else:
            self._set_picture(MAPS[name](self._result))

    def _set_picture(self, colours: Array) -> None:
        self.picture.setImage((np.clip(colours, 0.0, 1.0) * 255.0).astype(np.uint8), autoLevels=False, levels=(0, 255))

    def _clicked(self, event: pg.GraphicsScene.mouseEvents.MouseClickEvent) -> None:
        point = self._box.mapSceneToView(event.scenePos())
        self.pick(int(np.floor(point.y())), int(np.floor(point.x())))

    def _moved(self, position: QPointF) -> None:
        # Only while the left button is held, and where relighting is what is shown.
        buttons = pg.QtWidgets.QApplication.mouseButtons()
        if self._result is None or self.map_box.currentText() != RELIT or not buttons & Qt.MouseButton.LeftButton:
            return
        point = self._box.mapSceneToView(position)
        grid = self._result.grid
        self.relight(2.0 * point.x() / grid.width - 1.0, 1.0 - 2.0 * point.y() / grid.height)

    def _ask(self) -> None:
        name, _ = QFileDialog.getOpenFileName(self, "Open a result", self.file_edit.text(), "Results (*.result.h5)")
        if name:
            self.file_edit.setText(name)
            self.open_file(Path(name))

    def _wire(self) -> None:
        self.open_button.clicked.connect(self._ask)
        self.file_edit.returnPressed.connect(lambda: self.open_file(Path(self.file_edit.text())))
        self.map_box.currentTextChanged.connect(self._show_map)
        self._box.scene().sigMouseClicked.connect(self._clicked)
        self._box.scene().sigMouseMoved.connect(self._moved)

    def _lay_out(self) -> None:
        self.curve.setLogMode(x=False, y=True)
        self.curve.setLabel("bottom", "half angle, deg")
        self.curve.setLabel("left", "BRDF, 1/sr")
        self.point_label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        row = QHBoxLayout()
        row.addWidget(self.file_edit, stretch=1)
        row.addWidget(self.open_button)
        row.addWidget(self.map_box)
        columns = QHBoxLayout()
        columns.addWidget(self.canvas, stretch=3)
        columns.addWidget(self.curve, stretch=2)
        column = QVBoxLayout(self)
        column.addLayout(row)
        column.addLayout(columns, stretch=1)
        column.addWidget(self.point_label)


def _relit(asked: tuple[Result, float, float]) -> Array:
    """Return the area in the light of a lamp over a point of it, as display colours."""
    result, x, y = asked
    width = result.grid.width * result.grid.pitch
    light = np.array([x * width, y * width, _LIGHT_HEIGHT * width])
    return display_colours(result.render(np.array([0.0, 0.0, 2.0 * width]), light))
