"""The devices of the rig: who they are, what they are set to, what they allow, and whether they are connected."""

from __future__ import annotations

from PySide6.QtWidgets import QVBoxLayout, QWidget

from drivers.camera import CameraDescription
from drivers.light import LightDescription
from drivers.stage import StageDescription
from gui.acquisition import Introduction
from gui.text import QT_TRANSLATE_NOOP, selectable

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
            self.labels[kind].setText("\n".join([heading, *_lines(device)]))


def _lines(device: Description) -> list[str]:
    lines = [f"{device.make} {device.model}".strip(), f"serial number {device.serial_number}"]
    if device.firmware:
        lines.append(f"firmware {device.firmware}")
    if isinstance(device, CameraDescription):
        lines.append(f"{device.width} x {device.height}, {device.bit_depth} bits")
    if isinstance(device, StageDescription):
        lines += [f"{a.name} {a.soft_limits.low:g} to {a.soft_limits.high:g} {a.soft_limits.unit}" for a in device.axes]
    return [*lines, *map(str, device.settings)]
