"""A field for a file, with a dialog to choose it that leaves the rest of the window alive."""

from __future__ import annotations

from pathlib import Path

from PySide6.QtWidgets import QFileDialog, QHBoxLayout, QLineEdit, QToolButton, QWidget


class FileField(QWidget):
    """A line to type a path into, and a button that opens a dialog beside the window.

    Parameters
    ----------
    edit : QLineEdit
        Holds the path.
    filter_text : str
        Which files the dialog offers, as in Qt.
    accept : QFileDialog.AcceptMode, optional
        Whether the file is to be opened or written.
    parent : QWidget, optional
        As in Qt.
    """

    def __init__(
        self,
        edit: QLineEdit,
        filter_text: str,
        accept: QFileDialog.AcceptMode = QFileDialog.AcceptMode.AcceptOpen,
        parent: QWidget | None = None,
    ) -> None:
        super().__init__(parent)
        self.edit = edit
        # Before there is the button: a proxy that comes later catches Tab in a circle between the two.
        edit.setParent(self)
        self.setFocusProxy(edit)
        # Not modal: STOP has to be within reach of the mouse at any moment.
        self.dialog = QFileDialog(self, self.tr("Choose a file"))
        self.dialog.setModal(False)
        self.dialog.setNameFilter(filter_text)
        self.dialog.setAcceptMode(accept)
        # What is there is refused by the engine, in words.
        self.dialog.setOption(QFileDialog.Option.DontConfirmOverwrite)
        self.dialog.fileSelected.connect(edit.setText)
        self.button = QToolButton()
        self.button.setText("…")
        self.button.setAccessibleName(self.tr("Choose a file"))
        self.button.setToolTip(self.tr("Choose a file"))
        self.button.clicked.connect(self._open)
        row = QHBoxLayout(self)
        row.setContentsMargins(0, 0, 0, 0)
        row.addWidget(edit, stretch=1)
        row.addWidget(self.button)

    def _open(self) -> None:
        folder = Path(self.edit.text()).parent
        if folder.is_dir():
            self.dialog.setDirectory(str(folder))
        self.dialog.show()
