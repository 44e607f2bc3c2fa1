"""From what the operating system says of a USB device to what its user can do."""

from __future__ import annotations

import errno
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.errors import DeviceError, DeviceLostError, DeviceTimeoutError
from drivers.udev import UDEV_RULES

_FORBIDDEN = (errno.EACCES, errno.EPERM)
# A device that is pulled out fails its transfer in one of these ways, depending on when.
_GONE = (errno.ENODEV, errno.ENOENT, errno.EIO, errno.EPROTO, errno.ESHUTDOWN)


@contextmanager
def usb_errors_explained(device: str) -> Iterator[None]:
    """Raise an error of USB as a `DeviceError` that says what to do; every other one passes.

    Parameters
    ----------
    device : str
        Which device, for the message.
    """
    try:
        yield
    except DeviceError:
        raise
    except OSError as error:
        # pyusb's USBError is one; where libusb states no error number it is a plain failure.
        raise explained(error, device) from None


def explained(error: OSError, device: str) -> DeviceError:
    """Return the `DeviceError` that an error of USB stands for."""
    if error.errno == errno.ETIMEDOUT:
        return DeviceTimeoutError(f"{device} did not answer in time. Look whether it is switched on, and try again")
    if error.errno in _GONE:
        return DeviceLostError(f"{device} is gone. Look at its cable and its power, then connect it again")
    if error.errno in _FORBIDDEN:
        return DeviceError(
            f"no permission to open {device}. Copy {UDEV_RULES} to /etc/udev/rules.d, run "
            "`udevadm control --reload && udevadm trigger` as root, and plug the device in again"
        )
    if error.errno == errno.EBUSY:
        return DeviceError(
            f"{device} is in use by another process or by the kernel's driver usbtmc. "
            "End the other program, or run `rmmod usbtmc` as root"
        )
    return DeviceError(f"{device} failed: {error}")
