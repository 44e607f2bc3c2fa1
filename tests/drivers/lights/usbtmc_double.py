"""A USB bus with USBTMC devices on it, for pyusb: what libusb would see, transfer by transfer.

It follows the USBTMC specification 1.0 and stalls whatever does not.
"""

import errno
import struct
from array import array
from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any, Protocol

import usb.core
from usb.backend import IBackend

BULK_OUT, BULK_IN = 0x01, 0x82
PACKET_SIZE = 64
INITIATE_CLEAR, CHECK_CLEAR_STATUS, GET_CAPABILITIES = 5, 6, 7
INITIATE_ABORT_BULK_IN, CHECK_ABORT_BULK_IN_STATUS = 3, 4
SUCCESS, PENDING, NOT_IN_PROGRESS = 0x01, 0x02, 0x81
_STRINGS = {1: "Double", 2: "LED driver"}


class Instrument(Protocol):
    """What is behind the interface: a message in, an answer or none out."""

    def receive(self, message: bytes) -> bytes | None: ...


def failure(number: int) -> usb.core.USBError:
    kind = usb.core.USBTimeoutError if number == errno.ETIMEDOUT else usb.core.USBError
    return kind(errno.errorcode[number], -1, number)


class UsbTmcDevice:
    """One device; set its attributes to make it fail."""

    def __init__(
        self, instrument: Instrument, serial_number: str = "M00000001", ids: tuple[int, int] = (0x1313, 0x80C8)
    ):
        self.instrument, self.serial_number, self.ids = instrument, serial_number, ids
        self.interface_class = 0xFE
        self.plugged_in = True
        self.open_error: int | None = None
        self.claim_error: int | None = None
        self.kernel_driver = False
        self.n_open = 0
        self.claimed = False
        self.n_transfers = 0
        # Number of the transfer -> errno that it fails with.
        self.failures: dict[int, int] = {}
        self.mute = False
        self.tag_offset = 0
        self._received = b""
        self._answer = b""
        self._clearing = False
        self._request: tuple[int, int] | None = None
        # How often a clear is reported to be under way before it is done.
        self.pending_clears = 1
        # Whether a clear leaves it with an answer that it cannot take back, which the host has to read.
        self.holds_answers = False
        self._pending = 0

    def begin_transfer(self) -> None:
        if not self.plugged_in:
            raise failure(errno.ENODEV)
        number = self.failures.get(self.n_transfers)
        self.n_transfers += 1
        if number == errno.ENODEV:
            self.plugged_in = False
        if number is not None:
            raise failure(number)

    def take(self, transfer: bytes) -> None:
        kind, tag, inverse, size, attributes = struct.unpack_from("<BBBxLBxxx", transfer)
        if len(transfer) % 4 or inverse != ~tag & 0xFF or tag == 0:
            raise failure(errno.EPIPE)
        if kind == 1 and len(transfer) == 12 + size + -size % 4:
            self._received += transfer[12 : 12 + size]
            if attributes & 1:
                message, self._received = self._received, b""
                # What nobody has read yet stays before it in the queue: a client that lost step gets the wrong answer.
                self._answer += self.instrument.receive(message) or b""
        elif kind == 2 and len(transfer) == 12:
            self._request = (tag, size)
        else:
            raise failure(errno.EPIPE)

    def give(self) -> bytes:
        if self._clearing and self._answer:
            left_over, self._answer = self._answer, b""
            return left_over
        if self._request is None or not self._answer or self.mute:
            raise failure(errno.ETIMEDOUT)
        (tag, size), self._request = self._request, None
        part, self._answer = self._answer[:size], self._answer[size:]
        tag += self.tag_offset
        header = struct.pack("<BBBxLBxxx", 2, tag, ~tag & 0xFF, len(part), int(not self._answer))
        return header + part + bytes(-len(part) % 4)

    def control(self, request_type: int, request: int, value: int, size: int) -> bytes:
        if (request_type, request) == (0x80, 6) and value >> 8 == 3:
            return self._string(value & 0xFF)[:size]
        if (request_type, request) == (0xA1, GET_CAPABILITIES):
            return bytes([SUCCESS, 0, 0x00, 0x01, 0, 0, *[0] * 6, 0x00, 0x01, 0x04, 0x08, *[0] * 8])
        if (request_type, request) == (0xA1, INITIATE_CLEAR):
            self._received, self._request = b"", None
            self._answer = self._answer if self.holds_answers else b""
            self._clearing = True
            self._pending = self.pending_clears
            return bytes([SUCCESS])
        if (request_type, request) == (0xA1, CHECK_CLEAR_STATUS):
            self._pending -= 1
            if self._pending >= 0 or self._answer:
                return bytes([PENDING, bool(self._answer)])
            self._clearing = False
            return bytes([SUCCESS, 0])
        if request_type == 0xA2 and request in (INITIATE_ABORT_BULK_IN, CHECK_ABORT_BULK_IN_STATUS):
            return bytes([NOT_IN_PROGRESS, 0])
        raise failure(errno.EPIPE)

    def _string(self, index: int) -> bytes:
        text = struct.pack("<H", 0x0409) if index == 0 else self._text(index).encode("utf-16-le")
        return bytes([2 + len(text), 3]) + text

    def _text(self, index: int) -> str:
        return {**_STRINGS, 3: self.serial_number}[index]


class UsbBus(IBackend):
    """A `usb.backend.IBackend` whose devices are doubles."""

    def __init__(self, *devices: UsbTmcDevice) -> None:
        super().__init__()
        self.devices = list(devices)

    def enumerate_devices(self) -> Iterator[UsbTmcDevice]:
        return iter([device for device in self.devices if device.plugged_in])

    def get_parent(self, dev: UsbTmcDevice) -> None:
        return None

    def get_device_descriptor(self, dev: UsbTmcDevice) -> Any:
        vendor, product = dev.ids
        return SimpleNamespace(
            bLength=18, bDescriptorType=1, bcdUSB=0x0200, bDeviceClass=0, bDeviceSubClass=0, bDeviceProtocol=0,
            bMaxPacketSize0=64, idVendor=vendor, idProduct=product, bcdDevice=0x0100, iManufacturer=1, iProduct=2,
            iSerialNumber=3, bNumConfigurations=1, address=self.devices.index(dev) + 1, bus=1, port_number=1,
            port_numbers=(1,), speed=3,
        )  # fmt: skip

    def get_configuration_descriptor(self, dev: UsbTmcDevice, config: int) -> Any:
        if config:
            raise IndexError(config)
        return SimpleNamespace(
            bLength=9, bDescriptorType=2, wTotalLength=32, bNumInterfaces=1, bConfigurationValue=1, iConfiguration=0,
            bmAttributes=0xC0, bMaxPower=0, extra_descriptors=[],
        )  # fmt: skip

    def get_interface_descriptor(self, dev: UsbTmcDevice, intf: int, alt: int, config: int) -> Any:
        if intf or alt or config:
            raise IndexError((intf, alt, config))
        return SimpleNamespace(
            bLength=9, bDescriptorType=4, bInterfaceNumber=0, bAlternateSetting=0, bNumEndpoints=2,
            bInterfaceClass=dev.interface_class, bInterfaceSubClass=3, bInterfaceProtocol=1, iInterface=0,
            extra_descriptors=[],
        )  # fmt: skip

    def get_endpoint_descriptor(self, dev: UsbTmcDevice, ep: int, intf: int, alt: int, config: int) -> Any:
        return SimpleNamespace(
            bLength=7, bDescriptorType=5, bEndpointAddress=(BULK_OUT, BULK_IN)[ep], bmAttributes=2,
            wMaxPacketSize=PACKET_SIZE, bInterval=0, bRefresh=0, bSynchAddress=0, extra_descriptors=[],
        )  # fmt: skip

    def open_device(self, dev: UsbTmcDevice) -> UsbTmcDevice:
        if dev.open_error is not None:
            raise failure(dev.open_error)
        dev.n_open += 1
        return dev

    def close_device(self, dev_handle: UsbTmcDevice) -> None:
        dev_handle.n_open -= 1

    def get_configuration(self, dev_handle: UsbTmcDevice) -> int:
        return 1

    def set_configuration(self, dev_handle: UsbTmcDevice, config_value: int) -> None:
        pass

    def claim_interface(self, dev_handle: UsbTmcDevice, intf: int) -> None:
        if dev_handle.claim_error is not None or dev_handle.kernel_driver or dev_handle.claimed:
            raise failure(dev_handle.claim_error or errno.EBUSY)
        dev_handle.claimed = True

    def release_interface(self, dev_handle: UsbTmcDevice, intf: int) -> None:
        dev_handle.claimed = False
        if not dev_handle.plugged_in:
            raise failure(errno.ENODEV)

    def bulk_write(self, dev_handle: UsbTmcDevice, ep: int, intf: int, data: array, timeout: int) -> int:
        dev_handle.begin_transfer()
        dev_handle.take(data.tobytes())
        return len(data)

    def bulk_read(self, dev_handle: UsbTmcDevice, ep: int, intf: int, buff: array, timeout: int) -> int:
        dev_handle.begin_transfer()
        return _fill(buff, dev_handle.give())

    def ctrl_transfer(
        self,
        dev_handle: UsbTmcDevice,
        request_type: int,
        request: int,
        value: int,
        index: int,
        data: array,
        timeout: int,
    ) -> int:
        dev_handle.begin_transfer()
        return _fill(data, dev_handle.control(request_type, request, value, len(data)))

    def clear_halt(self, dev_handle: UsbTmcDevice, ep: int) -> None:
        dev_handle.begin_transfer()

    def is_kernel_driver_active(self, dev_handle: UsbTmcDevice, intf: int) -> bool:
        return dev_handle.kernel_driver

    def detach_kernel_driver(self, dev_handle: UsbTmcDevice, intf: int) -> None:
        dev_handle.kernel_driver = False

    def attach_kernel_driver(self, dev_handle: UsbTmcDevice, intf: int) -> None:
        dev_handle.kernel_driver = True


def _fill(buffer: array, data: bytes) -> int:
    if len(data) > len(buffer):
        raise failure(errno.EOVERFLOW)
    buffer[: len(data)] = array("B", data)
    return len(data)
