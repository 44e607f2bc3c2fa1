"""Which serial ports there are, and whether they can be used; none of them is opened."""

from __future__ import annotations

import os
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

from drivers.driver import DeviceState, FoundDevice
from drivers.errors import DriverNotFoundError

_NAME_IT = (
    "which device it is, only the rig file says: name the port in [light.device] or [stage.device], "
    "then `halfangle rig check` asks it"
)

_JOIN_GROUP = (
    "join the group that owns the port (on Debian: sudo usermod -aG dialout $USER), or copy the udev rules of "
    "drivers/udev/60-halfangle.rules; log out and in again"
)


def find_serial_ports() -> Iterator[FoundDevice]:
    """Yield every serial port that has a device behind it.

    To open a port would restart many a board behind it, so what is there is not asked.

    Raises
    ------
    DriverNotFoundError
        If pyserial is not installed.
    """
    try:
        ports = import_module("serial.tools.list_ports").comports()
    except ModuleNotFoundError:
        raise DriverNotFoundError('serial ports need pyserial. Install it: pip install "halfangle[serial]"') from None
    for port in sorted(ports):
        # A computer lists its own sockets too, most of which have no hardware behind them.
        if port.hwid != "n/a":
            state, remedy = _state(port.device)
            yield FoundDevice(_name(port), _lasting_name(port.device), state, remedy=remedy)


def holder(port: str) -> str:
    """Return the process that has a port open, as far as this user may see it; empty if none."""
    meant = os.path.realpath(port)
    for opened in Path("/proc").glob("[0-9]*/fd/*"):
        try:
            if str(opened.readlink()) == meant:
                process = opened.parents[1]
                return f"process {process.name}, {(process / 'comm').read_text().strip()}"
        except OSError:
            continue  # it ended meanwhile, or is somebody else's
    return ""


def _state(port: str) -> tuple[DeviceState, str]:
    if not os.access(port, os.R_OK | os.W_OK):
        return DeviceState.NO_PERMISSION, _JOIN_GROUP
    who = holder(port)
    if who:
        return DeviceState.BUSY, f"it is open in {who}; close that"
    return DeviceState.UNKNOWN, _NAME_IT


def _name(port: object) -> str:
    parts = (getattr(port, name, None) for name in ("manufacturer", "product", "serial_number"))
    return " ".join(part for part in parts if part) or str(getattr(port, "description", ""))


def _lasting_name(port: str) -> str:
    """Return the name that outlives a new plugging, where the system keeps one."""
    for link in sorted(Path("/dev/serial/by-id").glob("*")):
        if os.path.realpath(link) == os.path.realpath(port):
            return str(link)
    return port
