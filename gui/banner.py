"""What went wrong, in red, until somebody has acknowledged it."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QWidget

STYLE = "background: #a00000; color: white; font: 15px"
_MOST_TEXTS = 5


class Banner(QWidget):
    """Shows the newest of what it was told, each once; hidden when there is nothing."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._texts: list[str] = []
        self._label = QLabel(wordWrap=True)
        self._label.setTextFormat(Qt.TextFormat.PlainText)
        self._label.setTextInteractionFlags(Qt.TextInteractionFlag.TextSelectableByMouse)
        self.acknowledge_button = QPushButton("Ac&knowledge")
        self.acknowledge_button.clicked.connect(self.acknowledge)
        row = QHBoxLayout(self)
        row.addWidget(self._label, stretch=1)
        row.addWidget(self.acknowledge_button)
        self.setStyleSheet(STYLE)
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self.hide()

    def text(self) -> str:
        """Return what it shows."""
        return self._label.text()

    def tell(self, text: str) -> None:
        """Show a text below those before, until they are acknowledged."""
        if text not in self._texts:
            self._texts = [*self._texts, text][-_MOST_TEXTS:]
        self._label.setText("\n".join(self._texts))
        self.show()

    def acknowledge(self) -> None:
        """Hide what it shows."""
        self._texts.clear()
        self._label.clear()
        self.hide()
