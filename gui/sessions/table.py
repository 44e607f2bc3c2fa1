"""The files of a folder: a small picture, how far each session came, and what it is called."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PySide6.QtCore import QCoreApplication, QSize, Qt
from PySide6.QtGui import QIcon, QImage, QPixmap
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget, QTableWidgetItem, QWidget

from gui.widgets.text import QT_TRANSLATE_NOOP
from instrument.files import derived_names
from instrument.files.validation import printable
from instrument.session.layout import Status
from instrument.session_tools.summary import DAMAGED, OTHER

Pictures = Mapping[Path, NDArray[np.uint8]]

COLUMNS = (
    QT_TRANSLATE_NOOP("SessionsTable", "File"),
    QT_TRANSLATE_NOOP("SessionsTable", "State"),
    QT_TRANSLATE_NOOP("SessionsTable", "Poses"),
    QT_TRANSLATE_NOOP("SessionsTable", "Begun"),
    QT_TRANSLATE_NOOP("SessionsTable", "Title"),
)

FILE, STATE, POSES, BEGUN, TITLE = range(len(COLUMNS))

N_OF_ALL = QT_TRANSLATE_NOOP("SessionsTable", "{done} of {all}")

# A sign that is told apart without its colour, and the word.
STATES = {
    Status.COMPLETE.value: ("✓", QT_TRANSLATE_NOOP("SessionsTable", "complete")),
    Status.INTERRUPTED.value: ("◐", QT_TRANSLATE_NOOP("SessionsTable", "interrupted")),
    Status.ABORTED.value: ("■", QT_TRANSLATE_NOOP("SessionsTable", "aborted")),
    Status.RECORDING.value: ("●", QT_TRANSLATE_NOOP("SessionsTable", "recording")),
    DAMAGED: ("✗", QT_TRANSLATE_NOOP("SessionsTable", "damaged")),
    OTHER: ("–", QT_TRANSLATE_NOOP("SessionsTable", "no session")),
    derived_names.STACK: ("–", QT_TRANSLATE_NOOP("SessionsTable", "stack")),
    derived_names.RESULT: ("–", QT_TRANSLATE_NOOP("SessionsTable", "result")),
}

_PICTURE = QSize(72, 54)


class SessionsTable(QTableWidget):
    """One row a file; keys move from row to row, and Tab leaves."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(0, len(COLUMNS), parent)
        self.setHorizontalHeaderLabels([_tr(name) for name in COLUMNS])
        self.setAccessibleName(self.tr("Sessions"))
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setSelectionMode(QAbstractItemView.SelectionMode.SingleSelection)
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setTabKeyNavigation(False)
        self.setIconSize(_PICTURE)
        self.verticalHeader().hide()
        self.horizontalHeader().setSectionResizeMode(QHeaderView.ResizeMode.ResizeToContents)
        self.horizontalHeader().setStretchLastSection(True)

    @property
    def path(self) -> Path | None:
        """The file that is selected."""
        rows = self.selectionModel().selectedRows(FILE)
        return Path(rows[0].data(Qt.ItemDataRole.UserRole)) if rows else None

    def show_files(self, rows: list[dict[str, Any]], pictures: Pictures) -> None:
        """Show what was found of each file; the file that was selected stays so.

        Parameters
        ----------
        rows : list of dict
            Of `instrument.session_tools.summary.summarise_all`.
        pictures : mapping of Path to ndarray of uint8, shape (h, w)
        """
        selected = self.path
        self.setRowCount(len(rows))
        for i_row, row in enumerate(rows):
            items = [QTableWidgetItem(printable(text)) for text in _cells(row)]
            for i_column, item in enumerate(items):
                item.setToolTip(item.text())
                self.setItem(i_row, i_column, item)
            items[FILE].setData(Qt.ItemDataRole.UserRole, row["path"])
            if Path(row["path"]) in pictures:
                items[FILE].setIcon(_icon(pictures[Path(row["path"])]))
        self.resizeRowsToContents()
        self.select(selected)

    def select(self, path: Path | None) -> None:
        """Select a file, or nothing if it is not in the list."""
        self.clearSelection()
        for i_row in range(self.rowCount()):
            place = self.model().index(i_row, FILE).data(Qt.ItemDataRole.UserRole)
            if path is not None and Path(place) == path:
                self.selectRow(i_row)


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    name, state = Path(row["path"]).name, _state(row)
    sign, word = STATES[state]
    texts = name, f"{sign} {_tr(word)}"
    if "problems" in row:
        is_ours = state in (derived_names.STACK, derived_names.RESULT)
        return *texts, "", "", "" if is_ours else row["problems"][0][1]
    poses = _tr(N_OF_ALL).format(done=row["n_complete"], all=row["n_poses"])
    return *texts, poses, row["start_time"][:16].replace("T", " "), row["title"]


def _state(row: dict[str, Any]) -> str:
    """Return a key of `STATES`: what is no session may have been made of one."""
    made = [ending for ending in (derived_names.STACK, derived_names.RESULT) if row["path"].endswith(ending)]
    return made[0] if made and row["state"] == OTHER else str(row["state"])


def _tr(text: str) -> str:
    return QCoreApplication.translate("SessionsTable", text)


def _icon(grey: NDArray[np.uint8]) -> QIcon:
    height, width = grey.shape
    image = QImage(np.ascontiguousarray(grey).tobytes(), width, height, width, QImage.Format.Format_Grayscale8)
    # A copy: the bytes are gone after this.
    return QIcon(QPixmap.fromImage(image.copy()))
