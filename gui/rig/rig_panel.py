"""The devices of the rig: who they are, what they are set to, what they allow, and whether they are connected."""

from __future__ import annotations

from PySide6.QtWidgets import QVBoxLayout, QWidget

from drivers.camera import CameraDescription
from drivers.light import LightDescription
from drivers.stage import StageDescription
from gui.rig.acquisition import Introduction
from gui.widgets.text import QT_TRANSLATE_NOOP, selectable

KINDS = {
    "camera": QT_TRANSLATE_NOOP("RigPanel", "CAMERA"),
    "light": QT_TRANSLATE_NOOP("RigPanel", "LIGHT"),
    "stage": QT_TRANSLATE_NOOP("RigPanel", "STAGE"),
}

Description = CameraDescription | LightDescription | StageDescription


class RigPanel(QWidget):
    """A heading and a few lines for each device."""

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__(parent)
        self.labels = {kind: selectable("", self.tr(name)) for kind, name in KINDS.items()}
        column = QVBoxLayout(self)
        column.setContentsMargins(0, 0, 0, 0)
        for label in self.labels.values():
            column.addWidget(label)
        self.show_state(self.tr("not connected"))

    def show_state(self, text: str) -> None:
        """Say the same of every device."""
        for kind, label in self.labels.items():
            label.setText(f"{self.tr(KINDS[kind])}  {text}")

    def show_rig(self, rig: Introduction) -> None:
        """Show who the connected devices are."""
        devices: tuple[Description, ...] = (rig.camera, rig.light, rig.stage)
        for kind, device in zip(KINDS, devices, strict=True):
            heading = f"{self.tr(KINDS[kind])}  {self.tr('connected')}"
            self.labels[kind].setText("\n".join([heading, *self._lines(device)]))

    def _lines(self, device: Description) -> list[str]:
        lines = [f"{device.make} {device.model}".strip()]
        lines.append(self.tr("serial number {number}").format(number=device.serial_number))
        if device.firmware:
            lines.append(self.tr("firmware {version}").format(version=device.firmware))
        if isinstance(device, CameraDescription):
            size = self.tr("{width} x {height} pixels, {depth} bits")
            lines.append(size.format(width=device.width, height=device.height, depth=device.bit_depth))
        if isinstance(device, StageDescription):
            reach = self.tr("{axis} {low:g} to {high:g} {unit}")
            lines += [
                reach.format(axis=a.name, low=a.soft_limits.low, high=a.soft_limits.high, unit=a.soft_limits.unit)
                for a in device.axes
            ]
        return [*lines, *map(str, device.settings)]
