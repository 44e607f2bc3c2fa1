"""The USBTMC interface of a USB device, taken from whoever had it and given back."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from drivers.errors import DeviceError

_CLASS, _SUBCLASS = 0xFE, 0x03


@dataclass(frozen=True, slots=True)
class ClaimedInterface:
    """An interface that no other process can use now.

    Attributes
    ----------
    device : usb.core.Device
    number : int
        Of the interface.
    bulk_out, bulk_in : usb.core.Endpoint
        Messages to the device and from it.
    from_kernel : bool
        Whether Linux' own driver had it before, and gets it back.
    """

    device: Any
    number: int
    bulk_out: Any
    bulk_in: Any
    from_kernel: bool

    def release(self) -> None:
        """Give the interface back and close the device; a device that is gone needs neither."""
        util = import_module("usb.util")
        with suppress(OSError):
            util.release_interface(self.device, self.number)
        if self.from_kernel:
            _give_back(self.device, self.number)
        util.dispose_resources(self.device)


def find_tmc(configuration: Any) -> Any:
    """Return the USBTMC interface of a configuration; None where it has none."""
    return import_module("usb.util").find_descriptor(
        configuration, bInterfaceClass=_CLASS, bInterfaceSubClass=_SUBCLASS
    )


def claim(device: Any, name: str) -> ClaimedInterface:
    """Take the USBTMC interface of a device.

    Parameters
    ----------
    device : usb.core.Device
    name : str
        For the message.

    Raises
    ------
    DeviceError
        If it has none.
    OSError
        If another process has it (pyusb's USBError); then all is as before.
    """
    util = import_module("usb.util")
    try:
        interface = tmc_interface(device, name)
        from_kernel = _take_from_kernel(device, interface.bInterfaceNumber)
        try:
            util.claim_interface(device, interface)
        except OSError:
            if from_kernel:
                _give_back(device, interface.bInterfaceNumber)
            raise
    except BaseException:
        util.dispose_resources(device)
        raise
    bulk_out, bulk_in = (_bulk_endpoint(interface, direction) for direction in (util.ENDPOINT_OUT, util.ENDPOINT_IN))
    return ClaimedInterface(device, interface.bInterfaceNumber, bulk_out, bulk_in, from_kernel)


def tmc_interface(device: Any, name: str) -> Any:
    """Return the USBTMC interface of a device.

    Parameters
    ----------
    device : usb.core.Device
    name : str
        For the message.

    Raises
    ------
    DeviceError
        If it has none.
    """
    found = find_tmc(device.get_active_configuration())
    if found is None:
        raise DeviceError(f"{name} is no USBTMC device. Look at the ids in the rig file's [light.device]")
    return found


def is_with_kernel(device: Any, number: int) -> bool:
    """Return whether the kernel's own driver has an interface; only Linux has one."""
    try:
        return bool(device.is_kernel_driver_active(number))
    except NotImplementedError:
        return False


def _take_from_kernel(device: Any, number: int) -> bool:
    if not is_with_kernel(device, number):
        return False
    device.detach_kernel_driver(number)
    return True


def _give_back(device: Any, number: int) -> None:
    with suppress(OSError):
        device.attach_kernel_driver(number)


def _bulk_endpoint(interface: Any, direction: int) -> Any:
    util = import_module("usb.util")

    def is_meant(endpoint: Any) -> bool:
        is_bulk: bool = util.endpoint_type(endpoint.bmAttributes) == util.ENDPOINT_TYPE_BULK
        return is_bulk and direction == util.endpoint_direction(endpoint.bEndpointAddress)

    return util.find_descriptor(interface, custom_match=is_meant)
