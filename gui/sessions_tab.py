"""The sessions of a folder with their state, each to be verified or taken up again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from PySide6.QtCore import Qt, Signal
from PySide6.QtWidgets import (
    QAbstractItemView,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QTableWidget,
    QTableWidgetItem,
    QVBoxLayout,
    QWidget,
)

from gui.job import Job
from instrument.examination import Examination, examination
from instrument.summary import summarise_all

COLUMNS = ("State", "Poses", "File", "Title")


class SessionsTab(QWidget):
    """Looks at files in a thread of its own; shows what it found."""

    chosen = Signal(Path)  # the session to go on with

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.folder_edit = QLineEdit(".")
        self.look_button = QPushButton("&Look")
        self.verify_button = QPushButton("&Verify")
        self.use_button = QPushButton("&Go on with it")
        self.table = QTableWidget(0, len(COLUMNS))
        self.found_label = QLabel(wordWrap=True)
        self._job: Job | None = None
        self._lay_out()
        self._wire()
        self._enable()

    def look(self) -> None:
        """List the sessions of the folder."""
        folder = Path(self.folder_edit.text())
        self._begin(lambda *_: summarise_all(sorted(folder.glob("*.h5"))))

    def verify(self) -> None:
        """Check every frame of the session that is selected."""
        path = self.selected
        if path is not None:
            self._begin(lambda *_: examination(path))

    @property
    def selected(self) -> Path | None:
        """The session that is selected."""
        item = self.table.item(self.table.currentRow(), COLUMNS.index("File"))
        return None if item is None else Path(item.text())

    def close_job(self) -> None:
        """Wait for the look that is under way."""
        if self._job is not None:
            self._job.wait()

    def _begin(self, work: Any) -> None:
        if self._job is not None:
            return
        self._job = Job(work, self)
        self._job.succeeded.connect(self._show)
        self._job.failed.connect(self.found_label.setText)
        self._job.finished.connect(self._end)
        self._enable()
        self._job.start()

    def _end(self) -> None:
        self._job = None
        self._enable()

    def _show(self, found: list[dict[str, Any]] | Examination) -> None:
        if isinstance(found, Examination):
            problems = [str(problem) for problem in found.problems] or ["every check passed"]
            verdict = f"{found.path}: {len(found.good)} of {found.n_poses} poses are good"
            self.found_label.setText("\n".join([verdict, *problems]))
            return
        self.table.setRowCount(len(found))
        for i_row, row in enumerate(found):
            for i_column, text in enumerate(_cells(row)):
                self.table.setItem(i_row, i_column, QTableWidgetItem(text))
        self.table.resizeColumnsToContents()

    def _wire(self) -> None:
        self.look_button.clicked.connect(self.look)
        self.folder_edit.returnPressed.connect(self.look)
        self.verify_button.clicked.connect(self.verify)
        self.table.itemSelectionChanged.connect(self._enable)
        self.use_button.clicked.connect(self._choose)

    def _choose(self) -> None:
        if self.selected is not None:
            self.chosen.emit(self.selected)

    def _enable(self) -> None:
        self.look_button.setEnabled(self._job is None)
        for button in (self.verify_button, self.use_button):
            button.setEnabled(self._job is None and self.selected is not None)

    def _lay_out(self) -> None:
        self.table.setHorizontalHeaderLabels(COLUMNS)
        self.table.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.table.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.found_label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.found_label.setTextFormat(Qt.TextFormat.PlainText)
        row = QHBoxLayout()
        row.addWidget(self.folder_edit, stretch=1)
        for button in (self.look_button, self.verify_button, self.use_button):
            row.addWidget(button)
        column = QVBoxLayout(self)
        column.addLayout(row)
        column.addWidget(self.table, stretch=1)
        column.addWidget(self.found_label)


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    if "problems" in row:
        return row["state"], "", row["path"], row["problems"][0][1]
    return row["state"], f"{row['n_complete']} of {row['n_poses']}", row["path"], row["title"]
