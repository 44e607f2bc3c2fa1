"""USBTMC on pyusb: whole messages to and from one device.

A transport of our own: pyvisa-py reports a failed write without its error number, so that a late answer and a cable
that was pulled out look alike, and takes an answer to another request for its own; python-usbtmc had its last release
in 2014. Both are worth more as counterparts in the tests.

References
----------
USB Test and Measurement Class Specification 1.0 (2003), sections 3 and 4.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any, TypeVar

from drivers.errors import DeviceError, DeviceLostError, DeviceTimeoutError
from drivers.scpi_light.finding import find_device
from drivers.scpi_light.interface import ClaimedInterface, claim
from drivers.scpi_light.messages import HEADER_SIZE, message_out, next_tag, payload_in, request_in
from drivers.scpi_light.settings import UsbAddress
from drivers.scpi_light.usb_errors import usb_errors_explained

_INITIATE_CLEAR, _CHECK_CLEAR_STATUS = 5, 6
_SUCCESS, _PENDING = 1, 2
# bmRequestType: class request to an interface, device to host.
_CLASS_REQUEST_IN = 0xA1
_CLEAR_PAUSE = 0.02
# No answer of a LED controller is longer.
_ANSWER_SIZE, _LONGEST_ANSWER = 4096, 65_536

Result = TypeVar("Result")


class UsbTmc:
    """One USBTMC device.

    Parameters
    ----------
    address : UsbAddress
    answer_time : float
        Seconds that any transfer may take.
    backend : usb.backend.IBackend, optional
        None = libusb.
    """

    def __init__(self, address: UsbAddress, answer_time: float, backend: Any = None) -> None:
        self._name = f"the USB device {address}"
        self._address, self._backend = address, backend
        self._answer_time = answer_time
        self._interface: ClaimedInterface | None = None
        self._tag = 0

    @property
    def is_open(self) -> bool:
        """Whether the device is open; it is not any more once it was found to be gone."""
        return self._interface is not None

    def open(self) -> None:
        """Find the device, take its interface, and let it forget what it was asked before.

        Raises
        ------
        DeviceError
            If it is not there, not allowed, busy, or no USBTMC device; then nothing stays open.
        """
        device = find_device(self._address, self._backend)
        with usb_errors_explained(self._name):
            self._interface = claim(device, self._name)
        try:
            self.clear()
        except BaseException:
            self.close()
            raise

    def close(self) -> None:
        """Give the device back; safe to call twice."""
        interface, self._interface = self._interface, None
        if interface is not None:
            interface.release()

    def write(self, message: bytes) -> None:
        """Send one whole message."""
        self._transfer(lambda interface: self._send(interface, message_out(self._next_tag(), message)))

    def query(self, message: bytes) -> bytes:
        """Send one whole message and return the whole answer."""
        self.write(message)
        return self._transfer(self._receive)

    def clear(self) -> None:
        """Let the device drop what it has received and not yet sent (section 4.2.1.6)."""
        interface = self._required()
        with usb_errors_explained(self._name):
            status = self._request(interface, _INITIATE_CLEAR, 1)[0]
            if status != _SUCCESS:
                raise DeviceError(f"{self._name} refused to be cleared: status {status:#04x}. Switch it off and on")
            self._wait_until_clear(interface)
            interface.bulk_out.clear_halt()

    def _required(self) -> ClaimedInterface:
        if self._interface is None:
            raise DeviceLostError(f"{self._name} is not open. Connect it again")
        return self._interface

    def _transfer(self, transfer: Callable[[ClaimedInterface], Result]) -> Result:
        """Return what `transfer` returns; after a failure the device is cleared, or closed when it is gone."""
        interface = self._required()
        try:
            with usb_errors_explained(self._name):
                return transfer(interface)
        except DeviceLostError:
            self.close()
            raise
        except DeviceError:
            # Else a late answer would be taken for that to the next question.
            with suppress(DeviceError):
                self.clear()
            raise

    def _send(self, interface: ClaimedInterface, transfer: bytes) -> None:
        interface.bulk_out.write(transfer, self._milliseconds)

    def _receive(self, interface: ClaimedInterface) -> bytes:
        answer, ends = b"", False
        deadline = time.monotonic() + self._answer_time
        while not ends:
            if time.monotonic() > deadline or len(answer) > _LONGEST_ANSWER:
                raise DeviceTimeoutError(f"{self._name} answers without an end. Switch it off and on")
            tag = self._next_tag()
            self._send(interface, request_in(tag, _ANSWER_SIZE))
            transfer = interface.bulk_in.read(HEADER_SIZE + _ANSWER_SIZE, self._milliseconds).tobytes()
            part, ends = payload_in(tag, transfer)
            answer += part
        return answer

    def _next_tag(self) -> int:
        self._tag = next_tag(self._tag)
        return self._tag

    @property
    def _milliseconds(self) -> int:
        return round(1000.0 * self._answer_time)

    def _request(self, interface: ClaimedInterface, request: int, size: int) -> bytes:
        answer = interface.device.ctrl_transfer(
            _CLASS_REQUEST_IN, request, 0, interface.number, size, self._milliseconds
        )
        return bytes(answer)

    def _wait_until_clear(self, interface: ClaimedInterface) -> None:
        deadline = time.monotonic() + self._answer_time
        while True:
            status, bm_clear = self._request(interface, _CHECK_CLEAR_STATUS, 2)
            if status != _PENDING:
                return
            if time.monotonic() > deadline:
                raise DeviceTimeoutError(f"{self._name} does not clear. Switch it off and on")
            if bm_clear & 1:
                # It has an answer on its way that it cannot take back: somebody has to read it.
                interface.bulk_in.read(HEADER_SIZE + _ANSWER_SIZE, self._milliseconds)
            time.sleep(_CLEAR_PAUSE)
