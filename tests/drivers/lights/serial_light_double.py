"""A LED driver at the far end of a pseudo-terminal, with the words of docs/light-drivers.md."""

import os
import pty
import re
import select
import tty
from threading import Event, Thread

from tests.drivers.double_clock import HANG


class SerialLightDouble:
    """Serves a pty in a thread; set its attributes to make it fail. `port` is the name that a driver opens."""

    def __init__(self) -> None:
        self._controller, self._terminal = pty.openpty()
        tty.setraw(self._terminal)
        self.port = os.ttyname(self._terminal)
        self.identity = "blinker 2.1"
        self.lit, self.level = True, 10.0
        self.n_switched_on = 0
        self.mute = self.sticks_on = False
        # It obeys and answers only while this is set.
        self.may_answer = Event()
        self.may_answer.set()
        # Question -> what it says instead, as bytes, line end included.
        self.instead: dict[str, bytes] = {}
        # Numbers of the questions that it obeys, but does not answer.
        self.silent: set[int] = set()
        self.heard: list[str] = []
        self._stops, self._stop = os.pipe()
        self._thread = Thread(target=self._serve, daemon=True)
        self._thread.start()

    def say(self, text: bytes) -> None:
        """Send something that nobody asked for."""
        os.write(self._controller, text)

    def unplug(self) -> None:
        """Take the port away; safe to call twice."""
        if self._thread.is_alive():
            self.may_answer.set()
            os.write(self._stop, b"x")
            self._thread.join()
            for end in (self._controller, self._terminal, self._stops, self._stop):
                os.close(end)

    def _serve(self) -> None:
        rest = b""
        while True:
            ready, _, _ = select.select([self._controller, self._stops], [], [])
            if self._stops in ready:
                return
            *lines, rest = (rest + os.read(self._controller, 1024)).split(b"\n")
            for line in lines:
                self._reply(line.decode("ascii", "replace"))

    def _reply(self, line: str) -> None:
        self.heard.append(line)
        assert self.may_answer.wait(HANG)
        answer = self._obey(line)
        if not self.mute and len(self.heard) - 1 not in self.silent:
            os.write(self._controller, self.instead.get(line, answer.encode() + b"\r\n"))

    def _obey(self, line: str) -> str:
        if match := re.fullmatch(r"LEVEL (\d+\.\d\d)", line):
            self.level = float(match[1])
            return "OK" if self.level <= 100.0 else "ERR range"
        if line == "ON":
            self.lit = True
            self.n_switched_on += 1
            return "OK"
        if line == "OFF":
            self.lit = self.sticks_on and self.lit
            return "OK"
        states = {"ID?": self.identity, "STATE?": f"{'ON' if self.lit else 'OFF'} {self.level:.2f}"}
        return states.get(line, "ERR unknown")
