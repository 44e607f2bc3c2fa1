"""A result: its maps, samples and curve of a point that is picked, and the sample relit by dragging the light."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
import pyqtgraph as pg
from PySide6.QtCore import QCoreApplication, Qt, Signal
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLabel, QLineEdit, QSplitter, QVBoxLayout, QWidget

from gui.result.light_drag import LightDrag
from gui.result.map_picture import ColourBar, MapPicture, map_picture
from gui.result.point_view import PointView
from gui.widgets.files import FileField
from gui.widgets.newest import Newest
from gui.widgets.plots import Picture
from gui.widgets.text import QT_TRANSLATE_NOOP, selectable

if TYPE_CHECKING:
    from analysis.results.maps import ResultMap
    from analysis.results.points import PointSource
    from analysis.results.result import Result

RELIT = "relit"

TITLES = {
    "normals": QT_TRANSLATE_NOOP("ResultTab", "Normals"),
    "depth": QT_TRANSLATE_NOOP("ResultTab", "Depth"),
    "albedo": QT_TRANSLATE_NOOP("ResultTab", "Albedo"),
    "materials": QT_TRANSLATE_NOOP("ResultTab", "Materials"),
    "normal sigma": QT_TRANSLATE_NOOP("ResultTab", "Sigma of the normals"),
    "depth sigma": QT_TRANSLATE_NOOP("ResultTab", "Sigma of the depth"),
    "residual": QT_TRANSLATE_NOOP("ResultTab", "Residual"),
    RELIT: QT_TRANSLATE_NOOP("ResultTab", "Relit by a light to be dragged"),
}
"""What the operator reads, by the names of `analysis.results.maps.MAPS`."""

_MIN_LETTERS = 8  # of a map's title

_LIGHT_HEIGHT, _CAMERA_HEIGHT = 0.8, 2.0  # of what relights, in widths of the area


class _Drawing(NamedTuple):
    """A map that is asked for; with the light's place for the relit one."""

    result: Result
    name: str
    light: tuple[float, float]


class ResultTab(QWidget):
    """Shows a result file; reads and draws it in threads of their own."""

    shown = Signal()
    failed = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.file_edit = QLineEdit(placeholderText="sample.result.h5")
        self.file_field = FileField(self.file_edit, self.tr("Results (*.result.h5)"))
        self.map_box = QComboBox()
        for name, title in TITLES.items():
            self.map_box.addItem(QCoreApplication.translate("ResultTab", title), name)
        # As narrow as it has to be: the texts are longer than a small screen has room for.
        self.map_box.setSizeAdjustPolicy(QComboBox.SizeAdjustPolicy.AdjustToMinimumContentsLengthWithIcon)
        self.map_box.setMinimumContentsLength(_MIN_LETTERS)
        self.picture = Picture()
        self.picture.setAccessibleName(self.tr("Map of the result"))
        self.mark = _mark()
        for item in self.mark:
            self.picture.box.addItem(item, ignoreBounds=True)
        self.light = LightDrag(self.picture)
        self.bar = ColourBar()
        self.point = PointView()
        self.state_label = selectable(self.tr("no result is open"), self.tr("State of the result"))
        self.value_label = selectable(name=self.tr("Value under the cursor"))
        self._result: Result | None = None
        self._map: MapPicture | None = None
        self._pointed: tuple[int, int] | None = None
        self._reading = Newest(_read, self)
        self.drawing = Newest(_draw, self)
        self._lay_out()
        self._wire()

    @property
    def result(self) -> Result | None:
        """What is shown."""
        return self._result

    @property
    def map_name(self) -> str:
        """Which map is chosen."""
        return str(self.map_box.currentData())

    def choose_map(self, name: str) -> None:
        """Show a map, by its name in `TITLES`."""
        self.map_box.setCurrentIndex(self.map_box.findData(name))

    def open_file(self, path: Path) -> None:
        """Read a result and show it."""
        self.file_edit.setText(str(path))
        self.state_label.setText(self.tr("reading {path}").format(path=path))
        self._reading.ask(path)

    def pick(self, row: int, column: int) -> None:
        """Show the samples and the curve of a pixel, and mark it in the map."""
        if self._result is None:
            return
        for item in self.mark:
            item.setData(pos=[(column + 0.5, row + 0.5)])
        self.point.show_point(row, column)

    def relight(self, x: float, y: float) -> None:
        """Show the sample with the light over a place, from -1 to 1 across the area and up."""
        if self._result is not None and self.map_name == RELIT:
            self.drawing.ask(_Drawing(self._result, RELIT, (x, y)))

    def close_job(self) -> None:
        """Wait for what is being read or drawn."""
        for worker in (self._reading, self.drawing):
            worker.close()
        self.point.close_workers()

    def _show(self, read: PointSource) -> None:
        self._result, self._map, self._pointed = read.result, None, None
        self.value_label.setText("")
        self.state_label.setText(str(read.path))
        self.point.take(read)
        for item in self.mark:
            item.clear()
        self.picture.fit(self._result.grid.height, self._result.grid.width)
        self._ask_for_map()
        self.shown.emit()

    def _fail(self, why: str) -> None:
        self.state_label.setText(why)
        self.failed.emit(why)

    def _ask_for_map(self) -> None:
        self.light.switch_to(on=self._result is not None and self.map_name == RELIT)
        if self._result is not None and self.map_name != RELIT:
            self.drawing.ask(_Drawing(self._result, self.map_name, (0.0, 0.0)))

    def _show_map(self, drawn: tuple[str, MapPicture]) -> None:
        name, shown = drawn
        # Another one may have been chosen meanwhile.
        if name == self.map_name:
            self._map = shown
            self.picture.show_image(shown.image, shown.table)
            self.bar.show_scale(shown, self.map_box.currentText())
            if self._pointed is not None:
                self._tell_value(*self._pointed)

    def _tell_value(self, row: int, column: int) -> None:
        self._pointed = (row, column)
        text = self.tr("row {row}, column {column}: {value}")
        value = "" if self._map is None else self._map.text_at(row, column)
        self.value_label.setText(text.format(row=row, column=column, value=value))

    def _wire(self) -> None:
        self.file_edit.returnPressed.connect(lambda: self.open_file(Path(self.file_edit.text())))
        self.file_field.dialog.fileSelected.connect(lambda name: self.open_file(Path(name)))
        self.map_box.currentIndexChanged.connect(lambda _: self._ask_for_map())
        self.picture.picked.connect(self.pick)
        self.picture.pointed.connect(self._tell_value)
        self.light.moved.connect(self.relight)
        self._reading.done.connect(self._show)
        self._reading.failed.connect(self._fail)
        self.drawing.done.connect(self._show_map)
        self.drawing.failed.connect(self._fail)

    def _lay_out(self) -> None:
        row = QHBoxLayout()
        for text, field in ((self.tr("&File"), self.file_field), (self.tr("&Map"), self.map_box)):
            label = QLabel(text)
            label.setBuddy(field)
            row.addWidget(label)
            row.addWidget(field, stretch=2 if field is self.file_field else 1)
        left = QWidget()
        map_column = QVBoxLayout(left)
        map_column.setContentsMargins(0, 0, 0, 0)
        map_row = QHBoxLayout()
        map_row.addWidget(self.picture, stretch=1)
        map_row.addWidget(self.bar)
        map_column.addLayout(map_row, stretch=1)
        map_column.addWidget(self.value_label)
        columns = QSplitter(Qt.Orientation.Horizontal)
        columns.addWidget(left)
        columns.addWidget(self.point)
        columns.setSizes([600, 400])
        column = QVBoxLayout(self)
        column.addLayout(row)
        column.addWidget(self.state_label)
        column.addWidget(columns, stretch=1)


def _mark() -> tuple[pg.ScatterPlotItem, pg.ScatterPlotItem]:
    """Return the two lines of a cross that is seen on any colour."""
    lines = tuple(pg.ScatterPlotItem(symbol="x", size=s, pen=pg.mkPen(c, width=1)) for s, c in ((16, "w"), (10, "k")))
    for item in lines:
        item.setZValue(15)
    return lines[0], lines[1]


def _read(path: Path) -> PointSource:
    # Imported here, in the worker, since it takes as long as opening the window.
    from analysis.results.points import PointSource
    from analysis.results.result_file import read_result
    from instrument.files.probe import refuse_dangerous

    refuse_dangerous(path)
    return PointSource(path, read_result(path))


def _draw(asked: _Drawing) -> tuple[str, MapPicture]:
    from analysis.results.maps import MAPS

    shown = _relit(asked) if asked.name == RELIT else MAPS[asked.name](asked.result)
    return asked.name, map_picture(shown)


def _relit(asked: _Drawing) -> ResultMap:
    """Return the area in the light of a lamp over a place of it."""
    from analysis.results.maps import relit

    width, height = (n * asked.result.grid.pitch for n in (asked.result.grid.width, asked.result.grid.height))
    x, y = asked.light
    light = np.array([0.5 * x * width, 0.5 * y * height, _LIGHT_HEIGHT * width])
    return relit(asked.result, np.array([0.0, 0.0, _CAMERA_HEIGHT * width]), light)
