"""Find the one USB device that is meant, or say what there is instead."""

from __future__ import annotations

from importlib import import_module
from typing import Any

from drivers.errors import DeviceError, DriverNotFoundError
from drivers.scpi_light.settings import UsbAddress
from drivers.scpi_light.usb_errors import usb_errors_explained


def find_device(address: UsbAddress, backend: Any = None) -> Any:
    """Return the `usb.core.Device` at an address; every other one is left closed.

    Parameters
    ----------
    address : UsbAddress
    backend : usb.backend.IBackend, optional
        None = libusb.

    Raises
    ------
    DeviceError
        If it is not there, not the only one, or may not be opened.
    DriverNotFoundError
        If pyusb or libusb is not installed.
    """
    present = usb_devices(backend)
    alike = [d for d in present if (d.idVendor, d.idProduct) == (address.vendor_id, address.product_id)]
    serials = [_serial_number(device, address) for device in alike]
    matching = [d for d, serial in zip(alike, serials, strict=True) if address.serial_number in ("", serial)]
    if len(matching) == 1:
        return matching[0]
    found = [f"{d.idVendor:04x}:{d.idProduct:04x}" for d in present if d not in alike]
    found += [f"{d.idVendor:04x}:{d.idProduct:04x}, serial number {s}" for d, s in zip(alike, serials, strict=True)]
    raise DeviceError(_choice_message(address, len(matching), found))


def _choice_message(address: UsbAddress, n_matching: int, found: list[str]) -> str:
    listed = "; ".join(found) or "no USB device at all"
    if n_matching == 0:
        return (
            f"no USB device {address}; found: {listed}. Look at its cable, its power, and the rig file's [light.device]"
        )
    return f"{n_matching} USB devices {address}; found: {listed}. Set serial_number in the rig file's [light]"


def usb_devices(backend: Any = None) -> list[Any]:
    """Return every `usb.core.Device`, none of them opened.

    Raises
    ------
    DriverNotFoundError
        If pyusb or libusb is not installed.
    """
    try:
        core = import_module("usb.core")
    except ImportError:
        raise DriverNotFoundError("the light needs pyusb. Install halfangle[usb]") from None
    try:
        return list(core.find(find_all=True, backend=backend))
    except core.NoBackendError:
        raise DriverNotFoundError("pyusb finds no libusb. Install it, e.g. `apt install libusb-1.0-0`") from None


def _serial_number(device: Any, address: UsbAddress) -> str:
    util = import_module("usb.util")
    with usb_errors_explained(f"the USB device {address}"):
        try:
            # `device.serial_number` would hide why the languages cannot be read: no permission, or unplugged.
            languages = util.get_langids(device)
            return util.get_string(device, device.iSerialNumber, languages[0]) or "" if languages else ""
        finally:
            util.dispose_resources(device)
