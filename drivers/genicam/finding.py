"""Find the camera that is meant and open it, or say what there is instead."""

from __future__ import annotations

import ipaddress
import time

from drivers.errors import DeviceError, DeviceLostError
from drivers.genicam.aravis import AravisLink, listed_cameras
from drivers.genicam.gige import is_controlled
from drivers.genicam.link import GenicamLink
from drivers.genicam.listing import ListedCamera, choose
from drivers.genicam.usb import usb_cameras

CONTROL_PATIENCE = 3.5
"""Seconds after which a camera in the network has let go of a program that died: its heartbeat is 3 s."""

IN_USE = "End the other program that uses it, e.g. its maker's viewer, or wait until its connection has run out"


def open_camera(address: str, serial_number: str | None) -> GenicamLink:
    """Return the link to the one camera that is meant.

    Parameters
    ----------
    address : str
        In the network, or an id of Aravis; ``""`` = any.
    serial_number : str, optional
        None = any.

    Raises
    ------
    DriverNotFoundError
        If Aravis or PyGObject is not installed.
    DeviceError
        If it is not there, not the only one, in use, or may not be opened; then nothing stays open.
    """
    if _is_ip(address):
        return _opened_at(address, serial_number)
    camera = _chosen(address, serial_number)
    if camera.is_in_network:
        _check_free(camera.address, camera.name)
    _check_usb(camera.serial_number)
    return _opened(camera.device_id, camera.serial_number)


def _chosen(address: str, serial_number: str | None) -> ListedCamera:
    listed = listed_cameras()
    known = {camera.serial_number for camera in listed}
    unusable = [plugged.complaint for plugged in usb_cameras() if plugged.serial_number not in known]
    return choose(listed, address, serial_number, "; ".join(filter(None, unusable)))


def _opened_at(address: str, serial_number: str | None) -> GenicamLink:
    """Return the link to the camera at an address in the network, which is found without looking for others."""
    _check_free(address, f"the camera at {address}")
    try:
        return _opened(address, serial_number)
    except DeviceLostError:
        # Says what there is; a camera beyond a router is not among it.
        _chosen(address, serial_number)
        raise


def _opened(address: str, serial_number: str | None) -> GenicamLink:
    link = AravisLink(address)
    found = link.identity.serial_number
    if serial_number in (None, found):
        return link
    link.close()
    raise DeviceError(
        f"the camera at {address} has serial number {found}, not {serial_number}. "
        "Correct [camera] serial_number or [camera.device] address"
    )


def _check_free(address: str, name: str) -> None:
    if not is_controlled(address):
        return
    # It may be in the hands of a capture that was killed: these it opens by itself.
    time.sleep(CONTROL_PATIENCE)
    if is_controlled(address):
        raise DeviceError(f"{name} is in use by another program. {IN_USE}")


def _check_usb(serial_number: str) -> None:
    for plugged in usb_cameras():
        if plugged.serial_number == serial_number and plugged.complaint:
            raise DeviceError(plugged.complaint)


def _is_ip(address: str) -> bool:
    try:
        ipaddress.ip_address(address)
    except ValueError:
        return False
    return True
