"""What went wrong or should be known, until somebody has acknowledged it."""

from __future__ import annotations

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QHBoxLayout, QPushButton, QWidget

from gui.widgets.text import selectable

# The same in the dark and in the light theme; told apart by the word as well.
_STYLE = "font-size: 12pt; background: {}; color: {}"

FAULT_STYLE = _STYLE.format("#a00000", "white")

WARNING_STYLE = _STYLE.format("#f0c000", "black")

_MAX_TEXTS = 5


class Banner(QWidget):
    """Shows the newest of what it was told, each once; hidden when there is nothing."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self._texts: dict[str, bool] = {}
        self._label = selectable("", self.tr("Faults and warnings"))
        self.acknowledge_button = QPushButton(self.tr("Ac&knowledge"))
        self.acknowledge_button.clicked.connect(self.acknowledge)
        row = QHBoxLayout(self)
        row.addWidget(self._label, stretch=1)
        row.addWidget(self.acknowledge_button, alignment=Qt.AlignmentFlag.AlignTop)
        self.setAttribute(Qt.WidgetAttribute.WA_StyledBackground)
        self.hide()

    def text(self) -> str:
        """Return what it shows."""
        return self._label.text()

    @property
    def is_fault(self) -> bool:
        """Whether it is red: one of what it shows ended something."""
        return any(self._texts.values())

    def tell(self, text: str) -> None:
        """Show a fault below what was told before, until all is acknowledged."""
        self._show(text, is_fault=True)

    def warn(self, text: str) -> None:
        """Show what should be known though all goes on, in the same way."""
        self._show(text, is_fault=False)

    def acknowledge(self) -> None:
        """Hide what it shows."""
        self._texts.clear()
        self._label.clear()
        self.hide()

    def _show(self, text: str, *, is_fault: bool) -> None:
        self._texts[text] = is_fault or self._texts.get(text, False)
        # A fault is not pushed out by the warnings that come after it.
        for old in sorted(self._texts, key=self._texts.__getitem__)[: max(0, len(self._texts) - _MAX_TEXTS)]:
            del self._texts[old]
        words = {True: self.tr("FAULT"), False: self.tr("WARNING")}
        self._label.setText("\n".join(f"{words[fault]}: {text}" for text, fault in self._texts.items()))
        self.setStyleSheet(FAULT_STYLE if self.is_fault else WARNING_STYLE)
        self.show()
