"""USBTMC's bulk messages as bytes.

References
----------
USB Test and Measurement Class Specification 1.0 (2003), section 3.
"""

from __future__ import annotations

import struct

from drivers.errors import DeviceError

HEADER_SIZE = 12
DEV_DEP_MSG_OUT, REQUEST_DEV_DEP_MSG_IN, DEV_DEP_MSG_IN = 1, 2, 2
END_OF_MESSAGE = 1
_FIRST_TAG, _LAST_TAG = 1, 255
# MsgID, bTag, its inverse, reserved, TransferSize, bmTransferAttributes, 3 reserved.
_HEADER = struct.Struct("<BBBxLBxxx")


def next_tag(tag: int) -> int:
    """Return the tag after `tag`: 1 to 255, over and over."""
    return tag + 1 if tag < _LAST_TAG else _FIRST_TAG


def message_out(tag: int, payload: bytes) -> bytes:
    """Return a DEV_DEP_MSG_OUT that carries a whole message (table 3), padded to four bytes."""
    return _header(DEV_DEP_MSG_OUT, tag, len(payload), END_OF_MESSAGE) + payload + bytes(-len(payload) % 4)


def request_in(tag: int, size: int) -> bytes:
    """Return a REQUEST_DEV_DEP_MSG_IN for at most `size` bytes (table 4)."""
    return _header(REQUEST_DEV_DEP_MSG_IN, tag, size, 0)


def payload_in(tag: int, transfer: bytes) -> tuple[bytes, bool]:
    """Return what a DEV_DEP_MSG_IN carries (table 9), and whether it ends the message.

    Parameters
    ----------
    tag : int
        Of the request that it has to answer.
    transfer : bytes
        As read from the bulk-in endpoint.

    Raises
    ------
    DeviceError
        If it is torn, or answers another request.
    """
    if len(transfer) < HEADER_SIZE:
        raise DeviceError(f"a USBTMC answer of {len(transfer)} bytes; its header alone has {HEADER_SIZE}")
    kind, answered, inverse, size, attributes = _HEADER.unpack_from(transfer)
    if (kind, answered, inverse) != (DEV_DEP_MSG_IN, tag, ~tag & 0xFF):
        raise DeviceError(f"a USBTMC answer to request {answered}, message {kind}; expected was one to request {tag}")
    if len(transfer) < HEADER_SIZE + size:
        raise DeviceError(f"a USBTMC answer was cut: {len(transfer) - HEADER_SIZE} of {size} bytes came")
    return transfer[HEADER_SIZE : HEADER_SIZE + size], bool(attributes & END_OF_MESSAGE)


def _header(kind: int, tag: int, size: int, attributes: int) -> bytes:
    return _HEADER.pack(kind, tag, ~tag & 0xFF, size, attributes)
