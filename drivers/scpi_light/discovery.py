"""Which USBTMC instruments are plugged in, and whether they can be used."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from importlib import import_module
from typing import Any

from drivers.driver import DeviceState, FoundDevice
from drivers.scpi_light.finding import usb_devices
from drivers.scpi_light.interface import find_tmc, is_with_kernel, tmc_interface
from drivers.scpi_light.settings import ScpiLightSettings
from drivers.udev import UDEV_RULES

_STATES = {errno.EACCES: DeviceState.NO_PERMISSION, errno.EPERM: DeviceState.NO_PERMISSION}
_REMEDIES = {
    DeviceState.NO_PERMISSION: f"copy {UDEV_RULES} to /etc/udev/rules.d, run `udevadm control --reload && udevadm "
    "trigger` as root, and plug it in again",
    DeviceState.BUSY: "another process has it; end that",
    DeviceState.UNKNOWN: "if it takes the commands of a DC2200, name its vendor_id, product_id and model in "
    "[light.device]",
}


def find_instruments(backend: Any = None) -> Iterator[FoundDevice]:
    """Yield every USBTMC instrument: those that a rig file may leave unnamed as found, others as unknown.

    Parameters
    ----------
    backend : usb.backend.IBackend, optional
        None = libusb.

    Raises
    ------
    DriverNotFoundError
        If pyusb or libusb is not installed.
    """
    fields = ScpiLightSettings.model_fields
    known = (fields["vendor_id"].default, fields["product_id"].default)
    for device in usb_devices(backend):
        is_known = (device.idVendor, device.idProduct) == known
        if is_known or _is_instrument(device):
            yield _found(device, is_known)


def _found(device: Any, is_known: bool) -> FoundDevice:
    util = import_module("usb.util")
    where = f"usb {device.bus}-{device.address}, {device.idVendor:04x}:{device.idProduct:04x}"
    name = "Thorlabs DC2200" if is_known else "USBTMC instrument"
    try:
        name = " ".join(part for part in _strings(device) if part) or name
        state = _state(device) if is_known else DeviceState.UNKNOWN
    # pyusb's USBError, and a ValueError where it may not even read the languages.
    except (OSError, ValueError) as error:
        state = _STATES.get(getattr(error, "errno", None) or errno.EACCES, DeviceState.BUSY)
    finally:
        util.dispose_resources(device)
    return FoundDevice(name, where, state, _REMEDIES.get(state, ""))


def _strings(device: Any) -> Iterator[str | None]:
    util = import_module("usb.util")
    languages = util.get_langids(device)
    for index in (device.iManufacturer, device.iProduct, device.iSerialNumber):
        yield util.get_string(device, index, languages[0]) if languages and index else None


def _state(device: Any) -> DeviceState:
    """Take its interface for a moment, unless the kernel's driver has it: that one lets go of it when asked."""
    util = import_module("usb.util")
    interface = tmc_interface(device, "it")
    if is_with_kernel(device, interface.bInterfaceNumber):
        return DeviceState.FOUND
    util.claim_interface(device, interface)
    util.release_interface(device, interface)
    return DeviceState.FOUND


def _is_instrument(device: Any) -> bool:
    # Descriptors can be read without opening the device.
    return any(find_tmc(configuration) is not None for configuration in device)
