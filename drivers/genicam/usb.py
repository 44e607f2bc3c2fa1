"""USB3 Vision cameras as Linux knows them: also those that this user may not open, or that another program has.

Aravis lists only cameras that it can open.

References
----------
AIA, USB3 Vision 1.0.1 (2015), section 3: the interface's class, subclass and protocol.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from drivers.driver import DeviceState
from drivers.udev import UDEV_RULES

SYSFS = Path("/sys/bus/usb/devices")
NODES = Path("/dev/bus/usb")

_CONTROL_INTERFACE = {"bInterfaceClass": "ef", "bInterfaceSubClass": "05", "bInterfaceProtocol": "00"}
# What Linux calls a program that has an interface.
_A_PROGRAM = "usbfs"

_REMEDIES = {
    DeviceState.NO_PERMISSION: f"Copy {UDEV_RULES} to /etc/udev/rules.d, run `udevadm control --reload && "
    "udevadm trigger` as root, and plug the camera in again",
    DeviceState.BUSY: "End the other program that uses it, e.g. its maker's viewer",
}


@dataclass(frozen=True, slots=True)
class UsbCamera:
    """A USB3 Vision camera that is plugged in.

    Attributes
    ----------
    name : str
        Make, model and serial number.
    where : str
        Bus and number, e.g. ``"USB 002:005"``.
    """

    name: str
    where: str
    serial_number: str
    state: DeviceState

    @property
    def remedy(self) -> str:
        """What to do about its state; ``""`` where it can be used."""
        return _REMEDIES.get(self.state, "")

    @property
    def complaint(self) -> str:
        """Why it cannot be used, in a sentence; ``""`` where it can."""
        return f"{self.name} at {self.where}: {self.state.value}. {self.remedy}" if self.remedy else ""


def usb_cameras(sysfs: Path = SYSFS, nodes: Path = NODES) -> Iterator[UsbCamera]:
    """Yield the USB3 Vision cameras that are plugged in; none where the system is not Linux."""
    for interface in sorted(sysfs.glob("*:*")):
        if all(_word(interface / name) == value for name, value in _CONTROL_INTERFACE.items()):
            yield _camera(sysfs / interface.name.split(":")[0], interface, nodes)


def _camera(device: Path, interface: Path, nodes: Path) -> UsbCamera:
    bus, number = (int(_word(device / name) or 0) for name in ("busnum", "devnum"))
    serial_number = _word(device / "serial")
    return UsbCamera(
        name=f"{_word(device / 'manufacturer')} {_word(device / 'product')} (serial number {serial_number})",
        where=f"USB {bus:03d}:{number:03d}",
        serial_number=serial_number,
        state=_state(interface, nodes / f"{bus:03d}" / f"{number:03d}"),
    )


def _state(interface: Path, node: Path) -> DeviceState:
    if not os.access(node, os.R_OK | os.W_OK):
        return DeviceState.NO_PERMISSION
    driver = interface / "driver"
    return DeviceState.BUSY if driver.exists() and driver.resolve().name == _A_PROGRAM else DeviceState.FOUND


def _word(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").strip()
    except OSError:
        return ""
