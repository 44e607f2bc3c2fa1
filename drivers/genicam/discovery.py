"""Which GenICam cameras are attached, and whether they can be used."""

from __future__ import annotations

from collections.abc import Iterator

from drivers.driver import DeviceState, FoundDevice
from drivers.genicam.aravis import listed_cameras
from drivers.genicam.finding import IN_USE
from drivers.genicam.gige import is_controlled
from drivers.genicam.usb import usb_cameras


def find_cameras() -> Iterator[FoundDevice]:
    """Yield the cameras in the network and at USB, within about a second.

    Raises
    ------
    DriverNotFoundError
        If Aravis or PyGObject is not installed.
    """
    for camera in listed_cameras():
        if camera.is_in_network and is_controlled(camera.address):
            yield FoundDevice(camera.name, camera.address, DeviceState.BUSY, IN_USE)
        elif camera.is_in_network:
            yield FoundDevice(camera.name, camera.address, DeviceState.FOUND)
    # Linux knows all of those at USB, Aravis only the ones that it may open.
    for plugged in usb_cameras():
        yield FoundDevice(plugged.name, plugged.where, plugged.state, plugged.remedy)
