"""A serial port that says in words why it cannot be opened, and that it is gone."""

from __future__ import annotations

import errno
from importlib import import_module
from typing import Any

from drivers.errors import DeviceError, DeviceLostError, DeviceTimeoutError, DriverNotFoundError
from drivers.serial_link.discovery import holder

_WRITE_LIMIT = 2.0  # seconds

_MENDS = {
    errno.ENOENT: "There is no such port. Plug the device in, look at its cable and power, or correct the port's name",
    errno.ENXIO: "There is nothing at that port. Plug the device in, look at its cable and power",
    errno.EACCES: "You have no permission. Join the group that owns the port (on Debian: sudo usermod -aG dialout "
    "$USER), log out and in again",
    errno.ENOTTY: "That is no serial port. Correct the port's name",
}

_BUSY = (errno.EBUSY, errno.EAGAIN)

_UNKNOWN_MEND = "Look at the cable and the port's name"


class SerialPort:
    """An open port, 8 bits, no parity, for this process alone.

    Parameters
    ----------
    name : str
        As the system calls it, e.g. ``/dev/ttyACM0``; names below ``/dev/serial/by-id`` outlive a new plugging.
    baud_rate : int
        Bits per second.
    poll : float
        Seconds that `read` waits at most.

    Raises
    ------
    DriverNotFoundError
        If pyserial is not installed.
    DeviceError
        If the port cannot be opened: why, how to mend it, and which ports there are.
    """

    def __init__(self, name: str, baud_rate: int, poll: float) -> None:
        self.name = name
        self._serial = _opened(name, baud_rate, poll)

    def write(self, sent: bytes) -> None:
        """Send bytes.

        Raises
        ------
        DeviceLostError
            If the port is gone.
        DeviceTimeoutError
            If it takes nothing.
        """
        try:
            self._serial.write(sent)
        except _serial_module().SerialTimeoutException:
            raise DeviceTimeoutError(f"{self.name} takes nothing any more. Unplug the device and plug it in") from None
        except (OSError, TypeError, ValueError) as error:
            raise self._lost(error) from None

    def read(self, *, wait: bool = True) -> bytes:
        """Return what has arrived; if that is nothing, wait for a byte, or for the time that a poll takes.

        Raises
        ------
        DeviceLostError
            If the port is gone.
        """
        try:
            first: bytes = self._serial.read(1) if wait else b""
            return first + bytes(self._serial.read(self._serial.in_waiting))
        except (OSError, TypeError, ValueError) as error:
            raise self._lost(error) from None

    def close(self) -> None:
        """Give the port back; safe to call twice."""
        try:
            self._serial.close()
        except OSError as error:
            raise self._lost(error) from None

    def _lost(self, error: Exception) -> DeviceLostError:
        # pyserial meets a port that another thread closed with a TypeError.
        return DeviceLostError(f"{self.name} is gone ({error}). Look at the cable and the power, then connect again")


def port_names() -> tuple[str, ...]:
    """Return the serial ports that this computer has, with what is plugged in there."""
    ports = import_module("serial.tools.list_ports").comports()
    return tuple(f"{port.device} ({port.description})" for port in sorted(ports))


def usb_serial_number(name: str) -> str | None:
    """Return the serial number of the USB device behind a port; None where it has none."""
    ports = import_module("serial.tools.list_ports").comports(include_links=True)
    numbers: dict[str, str | None] = {port.device: port.serial_number for port in ports}
    return numbers.get(name)


def _opened(name: str, baud_rate: int, poll: float) -> Any:
    serial = _serial_module()
    try:
        # Exclusive: two programs on one port would each read half of the answers.
        return serial.Serial(name, baud_rate, timeout=poll, write_timeout=_WRITE_LIMIT, exclusive=True)
    except (OSError, ValueError) as error:
        raise DeviceError(f"cannot open {name}. {_mend(name, error)}. Ports here: {_listed(port_names())}.") from None


def _mend(name: str, error: Exception) -> str:
    # A termios.error, which pyserial wraps, carries its number in the text only.
    number = getattr(error, "errno", None) or next((n for n in (*_MENDS, *_BUSY) if f"({n}, " in str(error)), None)
    if number in _BUSY:
        return f"Another program uses the port{_in_brackets(holder(name))}. Close it"
    return _MENDS.get(number or 0, f"{_UNKNOWN_MEND} ({error})")


def _in_brackets(words: str) -> str:
    return f" ({words})" if words else ""


def _listed(names: tuple[str, ...]) -> str:
    return ", ".join(names) or "none"


def _serial_module() -> Any:
    try:
        return import_module("serial")
    except ModuleNotFoundError:
        raise DriverNotFoundError('serial devices need pyserial. Install it: pip install "halfangle[serial]"') from None
