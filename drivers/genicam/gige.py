"""Whether a GigE Vision camera is in another program's hands: asked without taking it.

Aravis takes control of whatever it opens, so it cannot be asked.

References
----------
AIA, GigE Vision 2.0 (2011), sections 13 (GVCP packets) and 28 (bootstrap registers).
"""

from __future__ import annotations

import socket
import struct

PORT = 3956
_ANSWER_TIME = 0.5  # seconds
_N_TRIES = 3
_KEY, _ACKNOWLEDGE = 0x42, 0x01
_READ_REGISTER, _READ_REGISTER_ANSWER = 0x0080, 0x0081
_CONTROL_CHANNEL_PRIVILEGE = 0x0A00
_SUCCESS = 0


def is_controlled(address: str) -> bool:
    """Return whether some program has control of the camera at an address; a silent one is in nobody's.

    Parameters
    ----------
    address : str
        Of the camera, IPv4.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as channel:
        channel.settimeout(_ANSWER_TIME)
        try:
            channel.connect((address, PORT))
            answer = next(filter(None, (_answer(channel, request_id) for request_id in range(1, _N_TRIES + 1))), b"")
        except OSError:
            return False
    return _says_controlled(answer)


def _answer(channel: socket.socket, request_id: int) -> bytes:
    channel.send(struct.pack(">BBHHHI", _KEY, _ACKNOWLEDGE, _READ_REGISTER, 4, request_id, _CONTROL_CHANNEL_PRIVILEGE))
    try:
        answer = channel.recv(64)
    except TimeoutError:
        return b""
    is_ours = len(answer) >= 8 and struct.unpack_from(">HH", answer, 2)[0] == _READ_REGISTER_ANSWER
    return answer if is_ours and struct.unpack_from(">H", answer, 6)[0] == request_id else b""


def _says_controlled(answer: bytes) -> bool:
    if not answer:
        return False
    # Who has exclusive control also forbids to read: the camera answers with an error.
    status = struct.unpack_from(">H", answer)[0]
    return bool(status != _SUCCESS or struct.unpack_from(">I", answer.ljust(12, b"\0"), 8)[0])
