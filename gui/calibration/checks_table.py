"""The checks of a calibration, the worst first, each with what to do next."""

from __future__ import annotations

from collections.abc import Sequence

from PySide6.QtCore import QCoreApplication, Qt, QTimer
from PySide6.QtWidgets import QAbstractItemView, QHeaderView, QTableWidget, QTableWidgetItem, QWidget

from analysis.reporting.checks import Check, Status
from gui.widgets.text import QT_TRANSLATE_NOOP
from instrument.files.validation import printable

COLUMNS = (
    QT_TRANSLATE_NOOP("ChecksTable", "Check"),
    QT_TRANSLATE_NOOP("ChecksTable", "Outcome"),
    QT_TRANSLATE_NOOP("ChecksTable", "Found"),
    QT_TRANSLATE_NOOP("ChecksTable", "Allowed"),
    QT_TRANSLATE_NOOP("ChecksTable", "What next"),
)

_OUTCOME, _NARROWEST_LETTERS = 1, 12

# A sign that is told apart without its colour, and the word of the report.
OUTCOMES = {Status.PASS: "✓ PASS", Status.WARN: "▲ WARN", Status.FAIL: "✗ FAIL"}


class ChecksTable(QTableWidget):
    """One row a check; keys move from row to row, and Tab leaves."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(0, len(COLUMNS), parent)
        self.setHorizontalHeaderLabels([QCoreApplication.translate("ChecksTable", name) for name in COLUMNS])
        self.setAccessibleName(self.tr("Checks of the calibration"))
        self.setSelectionBehavior(QAbstractItemView.SelectionBehavior.SelectRows)
        self.setEditTriggers(QAbstractItemView.EditTrigger.NoEditTriggers)
        self.setTabKeyNavigation(False)
        self.setWordWrap(True)
        self.verticalHeader().hide()
        header = self.horizontalHeader()
        header.setSectionResizeMode(QHeaderView.ResizeMode.Stretch)
        header.setSectionResizeMode(_OUTCOME, QHeaderView.ResizeMode.ResizeToContents)
        header.setMinimumSectionSize(_NARROWEST_LETTERS * self.fontMetrics().averageCharWidth())
        # Once all columns have their widths.
        self._fitting = QTimer(self, singleShot=True, interval=0)
        self._fitting.timeout.connect(self.resizeRowsToContents)
        header.sectionResized.connect(lambda *_: self._fitting.start())

    def show_checks(self, checks: Sequence[Check]) -> None:
        """Show checks in their order."""
        self.setRowCount(len(checks))
        for i_row, check in enumerate(checks):
            texts = (check.name, OUTCOMES[check.status], check.number, check.threshold, check.remedy)
            for i_column, text in enumerate(texts):
                item = QTableWidgetItem(printable(text))
                item.setToolTip(item.text())
                item.setTextAlignment(Qt.AlignmentFlag.AlignTop | Qt.AlignmentFlag.AlignLeft)
                self.setItem(i_row, i_column, item)
        self._fitting.start()
