"""Lets pyusb find a bus that is a double, in every Python process that has this folder on its path.

The environment variable HALFANGLE_TEST_USB names a folder. `device.json` there holds attributes of the double on the
bus (of `UsbTmcDevice`, and under "controller" of `Dc2200Double`); without that file the bus is empty. `record` is
written by the controller: a line with its level and the time each time that it changes.
"""

from __future__ import annotations

import atexit
import json
import os
import threading
import time
from pathlib import Path
from typing import Any


def _bus(folder: Path) -> Any:
    # Imported where they are needed: every process with this folder on its path runs this file first.
    from tests.drivers.lights.dc2200_double import Dc2200Double  # noqa: PLC0415
    from tests.drivers.lights.usbtmc_double import UsbBus, UsbTmcDevice  # noqa: PLC0415

    state = folder / "device.json"
    if not state.exists():
        return UsbBus()
    attributes = json.loads(state.read_text())
    controller = Dc2200Double(**attributes.pop("new", {}))
    for name, value in attributes.pop("controller", {}).items():
        setattr(controller, name, value)
    device = UsbTmcDevice(controller)
    for name, value in attributes.items():
        setattr(device, name, value)
    threading.Thread(target=_live, args=(folder, controller, device), daemon=True).start()
    return UsbBus(device)


def _live(folder: Path, controller: Any, device: Any) -> None:
    """Write down when it shines, and unplug it when somebody says so."""
    said = -1.0

    def note() -> None:
        nonlocal said
        level = controller.brightness / 100.0 if controller.lit else 0.0
        if level != said:
            with (folder / "record").open("a") as record:
                record.write(f"{level} {time.time()}\n")
            said = level

    # What a process does last is seen by the device, whose own life does not end with it.
    atexit.register(note)
    while True:
        note()
        device.plugged_in = device.plugged_in and not (folder / "unplug").exists()
        time.sleep(0.002)


if folder_named := os.environ.get("HALFANGLE_TEST_USB"):
    import usb.backend.libusb1

    _the_bus: list[Any] = []

    def _get_backend(*_: Any, **__: Any) -> Any:
        if not _the_bus:
            _the_bus.append(_bus(Path(folder_named)))
        return _the_bus[0]

    usb.backend.libusb1.get_backend = _get_backend
