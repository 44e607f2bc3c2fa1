"""The calibration of a session: from where it was seen, what is left of the corners, and the checks."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np
from PySide6.QtCore import QSignalBlocker, Qt, Signal
from PySide6.QtWidgets import QComboBox, QHBoxLayout, QLabel, QLineEdit, QPushButton, QSplitter, QVBoxLayout, QWidget

from analysis.reporting.calibration_file import SavedCalibration, calibration_beside
from analysis.reporting.checks import Status, count
from gui.calibration.checks_table import ChecksTable
from gui.calibration.directions_plot import DirectionsPlot
from gui.calibration.half_angles_plot import HalfAnglesPlot
from gui.calibration.residuals_plot import ResidualsPlot
from gui.widgets.files import FileField
from gui.widgets.newest import Newest
from gui.widgets.text import selectable
from instrument.files.probe import UNPACKED, refuse_dangerous
from instrument.session.session import Session


class Opened(NamedTuple):
    """A session, and its calibration; None if it has none of its frames as they are."""

    session: Path
    calibration: SavedCalibration | None


class CalibrationTab(QWidget):
    """Shows what `halfangle calibrate` kept of a session; reads it in a thread of its own."""

    calibrate_asked = Signal(Path)  # the session
    shown = Signal()
    failed = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.file_edit = QLineEdit(placeholderText="session.h5")
        self.file_field = FileField(self.file_edit, self.tr("Sessions (*.h5)"))
        self.calibrate_button = QPushButton(self.tr("Cali&brate"))
        self.pose_box = QComboBox()
        self.directions = DirectionsPlot()
        self.half_angles = HalfAnglesPlot()
        self.residuals = ResidualsPlot()
        self.checks_table = ChecksTable()
        self.state_label = selectable(self.tr("no session is open"), self.tr("State of the calibration"))
        self.pose_label = selectable(name=self.tr("Residuals of the pose"))
        self.coverage_label = selectable(name=self.tr("Half angles that are missing"))
        self._opened: Opened | None = None
        self._reading = Newest(_open, self)
        self._lay_out()
        self._wire()
        self._show(None)

    @property
    def calibration(self) -> SavedCalibration | None:
        """What is shown."""
        return None if self._opened is None else self._opened.calibration

    def open_session(self, session: Path) -> None:
        """Read the calibration of a session and show it."""
        self.file_edit.setText(str(session))
        self.state_label.setText(self.tr("reading {path}").format(path=session))
        self._reading.ask(session)

    def pick(self, view: int | None) -> None:
        """Bring out one view, by its number, or all of them."""
        with QSignalBlocker(self.pose_box):
            self.pose_box.setCurrentIndex(0 if view is None else view + 1)
        self.directions.pick(view)
        self.residuals.pick(view)
        self._tell_pose(view)

    def close_job(self) -> None:
        """Wait for what is being read."""
        self._reading.close()

    def _show(self, opened: Opened | None) -> None:
        self._opened = opened
        calibration = self.calibration
        views = () if calibration is None else calibration.views
        with QSignalBlocker(self.pose_box):
            self.pose_box.clear()
            self.pose_box.addItem(self.tr("all poses"))
            self.pose_box.addItems([self.tr("pose {pose}").format(pose=view.i_pose) for view in views])
        self.directions.show_views(views)
        self.residuals.show_views(views, (1, 1) if calibration is None else calibration.image_size)
        self.half_angles.show_coverage(None if calibration is None else calibration.coverage)
        self.checks_table.show_checks(() if calibration is None else calibration.checks)
        self.calibrate_button.setEnabled(opened is not None)
        self._tell_state()
        self.pick(None)
        self.shown.emit()

    def _fail(self, why: str) -> None:
        self._show(None)
        self.state_label.setText(why)
        self.failed.emit(why)

    def _tell_state(self) -> None:
        if self._opened is None:
            return
        calibration, coverage = self.calibration, ""
        if calibration is None:
            text = self.tr("{path} was never calibrated, or has changed since. Calibrate takes a minute or two.")
            self.state_label.setText(text.format(path=self._opened.session))
        else:
            n = {status: count(calibration.checks, status) for status in Status}
            text = self.tr("{path}: {fail} FAIL, {warn} WARN, {ok} PASS").format(
                path=self._opened.session, fail=n[Status.FAIL], warn=n[Status.WARN], ok=n[Status.PASS]
            )
            self.state_label.setText(text)
            advice = () if calibration.coverage is None else calibration.coverage.advice()
            coverage = "; ".join(advice)
        self.coverage_label.setText(coverage)

    def _tell_pose(self, view: int | None) -> None:
        calibration = self.calibration
        if calibration is None or not calibration.views:
            self.pose_label.setText("")
            return
        factor = self.tr("arrows {times:g} times as long").format(times=self.residuals.times)
        if view is None:
            text = self.tr("{n} views").format(n=len(calibration.views))
        else:
            seen = calibration.views[view]
            text = self.tr("pose {pose}: tilt {tilt:.1f} deg, {n} corners, {rms:.3f} px RMS, {out} left out").format(
                pose=seen.i_pose,
                tilt=np.rad2deg(seen.tilt),
                n=len(seen.corners),
                rms=seen.rms,
                out=seen.n_left_out,
            )
        self.pose_label.setText(f"{text}; {factor}")

    def _ask_to_calibrate(self) -> None:
        if self._opened is not None:
            self.calibrate_asked.emit(self._opened.session)

    def _wire(self) -> None:
        self.file_edit.returnPressed.connect(lambda: self.open_session(Path(self.file_edit.text())))
        self.file_field.dialog.fileSelected.connect(lambda name: self.open_session(Path(name)))
        self.calibrate_button.clicked.connect(self._ask_to_calibrate)
        self.pose_box.currentIndexChanged.connect(lambda i: self.pick(None if i <= 0 else i - 1))
        self.directions.picked.connect(self.pick)
        self.residuals.picked.connect(self.pick)
        self._reading.done.connect(self._show)
        self._reading.failed.connect(self._fail)

    def _lay_out(self) -> None:
        row = QHBoxLayout()
        for text, field in ((self.tr("&File"), self.file_field), (self.tr("&Pose"), self.pose_box)):
            label = QLabel(text)
            label.setBuddy(field)
            row.addWidget(label)
            row.addWidget(field, stretch=1 if field is self.file_field else 0)
        told = QHBoxLayout()
        told.addWidget(self.state_label, stretch=1)
        told.addWidget(self.calibrate_button)
        plots = QSplitter(Qt.Orientation.Horizontal)
        plots.addWidget(self._coverage())
        plots.addWidget(_stacked(self.residuals, self.pose_label))
        plots.setSizes([400, 600])
        rows = QSplitter(Qt.Orientation.Vertical)
        rows.addWidget(plots)
        rows.addWidget(self.checks_table)
        # Shares of the height; the pictures would take it all.
        rows.setSizes([600, 400])
        column = QVBoxLayout(self)
        column.addLayout(row)
        column.addLayout(told)
        column.addWidget(rows, stretch=1)

    def _coverage(self) -> QWidget:
        both = QSplitter(Qt.Orientation.Vertical)
        both.addWidget(self.directions)
        both.addWidget(_stacked(self.half_angles, self.coverage_label))
        return both


def _stacked(above: QWidget, below: QWidget) -> QWidget:
    widget = QWidget()
    column = QVBoxLayout(widget)
    column.setContentsMargins(0, 0, 0, 0)
    column.addWidget(above, stretch=1)
    column.addWidget(below)
    return widget


def _open(session: Path) -> Opened:
    refuse_dangerous(session, UNPACKED)
    with Session(session) as opened:
        digest = opened.digest()
    return Opened(session, calibration_beside(session, digest))
