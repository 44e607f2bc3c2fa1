"""Lines to a serial device and back: every one has its answer."""

from __future__ import annotations

import time

from drivers.errors import DeviceError, DeviceTimeoutError
from drivers.serial_link.port import SerialPort

QUIET_TIME = 0.1
"""Seconds without a byte after which a device that was out of step has said all that it had to say: the port's poll."""

_LONGEST_LINE = 1024


class LineDialogue:
    """Asks one line at a time.

    Parameters
    ----------
    port : SerialPort
        Open, with a poll of `QUIET_TIME`.
    answer_time : float
        Seconds that the device has for an answer.
    """

    def __init__(self, port: SerialPort, answer_time: float) -> None:
        self._port, self._answer_time = port, answer_time
        # Nobody knows what was said before the port was opened.
        self._in_step = self._has_answered = False

    def ask(self, line: str) -> str:
        """Return the answer to a line, without its end.

        Raises
        ------
        DeviceTimeoutError
            If no whole line comes: with what came.
        """
        self._hear_out()
        self._port.write(line.encode("ascii") + b"\n")
        self._in_step = False
        answer = self._line(line)
        self._in_step = self._has_answered = True
        return answer

    def lose_step(self) -> None:
        """Take nothing that comes unasked for an answer: the last one made no sense."""
        self._in_step = False

    def _hear_out(self) -> None:
        """Drop what was said unasked; after a failure also what is still under way."""
        deadline = time.monotonic() + self._answer_time
        while self._port.read(wait=not self._in_step):
            if time.monotonic() > deadline:
                raise DeviceError(f"{self._port.name} talks without an end. Look at the baud rate and at what is there")

    def _line(self, question: str) -> str:
        deadline = time.monotonic() + self._answer_time
        received = b""
        # An empty line is no answer: some firmware ends each of its own with one more.
        while not (received.endswith(b"\n") and received.strip()):
            # Looked at once more when its time is over: what a busy computer finds waiting came in time.
            late, arrived = time.monotonic() > deadline, self._port.read()
            received += arrived
            if late and not arrived:
                raise DeviceTimeoutError(self._silence(question, received))
            if len(received) > _LONGEST_LINE:
                raise DeviceError(f"{self._port.name} answers {question!r} with a line that does not end")
        return received.decode("ascii", errors="replace").strip()

    def _silence(self, question: str, received: bytes) -> str:
        came = f"only {received!r} came" if received else "nothing came"
        booting = "" if self._has_answered else "; a board that boots when its port is opened needs boot_time_s"
        return (
            f"{self._port.name} did not answer {question!r} within {self._answer_time:g} s: {came}. "
            f"Look at the power, the baud rate, and whether it is the right port{booting}"
        )
