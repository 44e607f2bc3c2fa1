"""Connect, live picture, exposure time with its read-back."""

from __future__ import annotations

from PySide6.QtCore import QSignalBlocker, Signal
from PySide6.QtWidgets import QAbstractSpinBox, QDoubleSpinBox, QFormLayout, QVBoxLayout, QWidget

from drivers.limits import Limits
from gui.widgets.actions import ActionButton
from gui.widgets.text import selectable

MS = 1e-3
"""A millisecond in seconds."""


class LiveControls(QWidget):
    """Says what is asked of the rig, and shows what it reads back."""

    exposure_time_asked = Signal(float)  # seconds

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.exposure_box = QDoubleSpinBox(decimals=3, suffix=" ms", maximum=1e6)
        # A number half typed is no exposure time yet.
        self.exposure_box.setKeyboardTracking(False)
        self.exposure_box.setStepType(QAbstractSpinBox.StepType.AdaptiveDecimalStepType)
        self.exposure_box.valueChanged.connect(lambda value: self.exposure_time_asked.emit(value * MS))
        self.read_back_label = selectable("", self.tr("Exposure time as read back"))
        self.connect_button = ActionButton("rig.connect")
        self.live_button = ActionButton("rig.live")
        form = QFormLayout()
        form.addRow(self.tr("E&xposure time"), self.exposure_box)
        form.addRow(self.tr("Read back"), self.read_back_label)
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        column.addLayout(form)
        column.addWidget(self.connect_button)
        column.addWidget(self.live_button)

    def show_limits(self, limits: Limits) -> None:
        """Let exposure times be chosen that the camera takes, seconds."""
        with QSignalBlocker(self.exposure_box):
            self.exposure_box.setRange(limits.low / MS, limits.high / MS)
        self.exposure_box.setToolTip(f"{limits.low:g} to {limits.high:g} {limits.unit}")

    def show_exposure_time(self, exposure_time: float) -> None:
        """Show what the camera reads back, in seconds."""
        self.read_back_label.setText(f"{exposure_time / MS:.3f} ms")
        # Once the operator turns the box, an older read-back must not turn it back.
        if not self.exposure_box.isEnabled():
            with QSignalBlocker(self.exposure_box):
                self.exposure_box.setValue(exposure_time / MS)

    def show_connected(self, *, connected: bool, can_connect: bool) -> None:
        """Let be asked for what can be done."""
        self.connect_button.setEnabled(can_connect)
        self.live_button.setEnabled(connected)
        self.exposure_box.setEnabled(connected)
