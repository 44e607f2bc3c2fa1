"""The sessions of a folder with their state, each to be verified, taken up again, looked at or processed again."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QLabel, QLineEdit, QPushButton, QVBoxLayout, QWidget

from gui.sessions.reprocessing import ReprocessingPanel
from gui.sessions.table import Pictures, SessionsTable
from gui.widgets.actions import ActionButton
from gui.widgets.files import FileField
from gui.widgets.job import Job, Work
from gui.widgets.text import selectable
from instrument.files import derived_names
from instrument.session_tools.examination import Examination, examination
from instrument.session_tools.summary import summarise_all
from instrument.session_tools.thumbnail import thumbnails_of


class SessionsTab(QWidget):
    """Looks at files in a thread of its own; shows what it found."""

    chosen = Signal(Path)  # the session to go on with
    calibration_asked = Signal(Path)  # the session whose calibration is to be shown
    result_asked = Signal(Path)  # the result to be shown
    line = Signal(str)  # of the log
    failed = Signal(str)

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.folder_edit = QLineEdit(".")
        self.folder_field = FileField(self.folder_edit, self.tr("Folders"))
        self.look_button = ActionButton("sessions.look")
        self.verify_button = ActionButton("sessions.verify")
        self.use_button = QPushButton(self.tr("&Go on with it"))
        self.show_button = QPushButton(self.tr("Sho&w"))
        self.table = SessionsTable()
        self.found_label = selectable(name=self.tr("What was found"))
        self.reprocessing = ReprocessingPanel()
        self._job: Job | None = None
        self._lay_out()
        self._wire()
        self._enable()

    def look(self) -> None:
        """List the sessions of the folder."""
        folder = Path(self.folder_edit.text())
        self._begin(lambda *_: files_of(folder))

    def verify(self) -> None:
        """Check every frame of the session that is selected."""
        path = self.selected
        if path is not None:
            self._begin(lambda *_: examination(path))

    def calibrate(self, session: Path) -> None:
        """Calibrate a session, be it in the list or not."""
        self.reprocessing.calibrate(session)

    @property
    def selected(self) -> Path | None:
        """The session that is selected."""
        return self.table.path

    def close_job(self) -> None:
        """Wait for the look that is under way, and end the command that runs."""
        if self._job is not None:
            self._job.wait()
        self.reprocessing.close_command()

    def _begin(self, work: Work) -> None:
        if self._job is not None:
            return
        self._job = Job(work, self)
        self._job.succeeded.connect(self._show)
        self._job.failed.connect(self._fail)
        self._job.finished.connect(self._end)
        self._enable()
        self._job.start()

    def _end(self) -> None:
        self._job = None
        self._enable()

    def _fail(self, why: str) -> None:
        self.found_label.setText(why)
        self.failed.emit(why)

    def _show(self, found: Files | Examination) -> None:
        if isinstance(found, Examination):
            problems = [str(problem) for problem in found.problems] or [self.tr("every check passed")]
            verdict = self.tr("{path}: {good} of {all} poses are good")
            text = verdict.format(path=found.path, good=len(found.good), all=found.n_poses)
            self.found_label.setText("\n".join([text, *problems]))
            return
        self.table.show_files(found.rows, found.pictures)
        nothing = self.tr("There is no HDF5 file (*.h5) in this folder.")
        self.found_label.setText("" if found.rows else nothing)

    def _wire(self) -> None:
        self.folder_field.dialog.setFileMode(QFileDialog.FileMode.Directory)
        self.folder_field.dialog.fileSelected.connect(self.look)
        self.look_button.clicked.connect(self.look)
        self.folder_edit.returnPressed.connect(self.look)
        self.verify_button.clicked.connect(self.verify)
        self.use_button.clicked.connect(self._choose)
        self.show_button.clicked.connect(self._show_selected)
        self.table.itemSelectionChanged.connect(self._enable)
        self.table.cellActivated.connect(self._show_selected)
        panel = self.reprocessing
        panel.line.connect(self.line)
        panel.failed.connect(self.failed)
        panel.calibrated.connect(self.calibration_asked)
        panel.reconstructed.connect(self.result_asked)
        panel.ended.connect(self.look)

    def _choose(self) -> None:
        if self.selected is not None:
            self.chosen.emit(self.selected)

    def _show_selected(self) -> None:
        if self.selected is not None:
            is_result = self.selected.name.endswith(derived_names.RESULT)
            (self.result_asked if is_result else self.calibration_asked).emit(self.selected)

    def _enable(self) -> None:
        self.look_button.setEnabled(self._job is None)
        for button in (self.verify_button, self.use_button, self.show_button):
            button.setEnabled(self._job is None and self.selected is not None)
        self.reprocessing.take(self.selected)

    def _lay_out(self) -> None:
        label = QLabel(self.tr("&Folder"))
        label.setBuddy(self.folder_edit)
        row = QHBoxLayout()
        row.addWidget(label)
        row.addWidget(self.folder_field, stretch=1)
        row.addWidget(self.look_button)
        acts = QHBoxLayout()
        for button in (self.verify_button, self.use_button, self.show_button):
            acts.addWidget(button)
        acts.addStretch()
        column = QVBoxLayout(self)
        column.addLayout(row)
        column.addWidget(self.table, stretch=1)
        column.addLayout(acts)
        column.addWidget(self.found_label)
        column.addWidget(self.reprocessing)


class Files(NamedTuple):
    """What was found in a folder: a row a file, and pictures of those that have one."""

    rows: list[dict[str, Any]]
    pictures: Pictures


def files_of(folder: Path) -> Files:
    """Look at every HDF5 file of a folder; runs in any thread.

    Raises
    ------
    NotADirectoryError
        If there is no such folder.
    """
    if not folder.is_dir():
        raise NotADirectoryError(f"{folder} is no folder; choose the one that the sessions are in")
    rows = summarise_all(sorted(folder.glob("*.h5")))
    return Files(rows, thumbnails_of([Path(row["path"]) for row in rows if "problems" not in row]))
