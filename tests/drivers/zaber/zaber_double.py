"""A double of a chain of Zaber devices on a pseudo-terminal.

After the manual of the ASCII protocol (firmware 7): commands with an id and a checksum, replies, flags, settings.
Strict: what is malformed is not answered, what is unknown or out of range is refused.
"""

from __future__ import annotations

import os
import re
import select
import threading
import tty
from contextlib import suppress
from math import inf

from tests.drivers.double_clock import DoubleClock
from tests.drivers.zaber.zaber_machine import AxisMachine

_TICK = 0.005  # seconds
# Microsteps; 1000 of them are a degree, 30 degrees per second, 200 per second squared.
_AXIS = {
    "limit.min": -200_000.0,
    "limit.max": 200_000.0,
    "maxspeed": 30_000.0 * 1.6384,
    "accel": 20.0 * 1.6384,
    "limit.approach.maxspeed": 25_000.0 * 1.6384,
}
_COMMAND = re.compile(r"/(\d+) (\d+) (\d\d)(?: ([^:]*))?:([0-9A-F]{2})")
_GRAVEST = "FF FN FZ FH FV FO FC FM FD FQ FI FA FR FS FB FP FE FT WL WV WT WS WM WP WR WH NC NI"  # first


class _RefusedError(Exception):
    """Ends a command with the reason of its refusal."""


class ZaberDouble:
    """Start it with ``with``; `port` is the name to open. Device 1 has one axis, device 2 has two.

    Parameters
    ----------
    pace : float
        Seconds of the devices that pass in a second.
    """

    def __init__(self, pace: float = 50.0) -> None:
        self.axes = {place: AxisMachine(dict(_AXIS)) for place in ((1, 1), (2, 1), (2, 2))}
        self.device_settings = {
            1: {"deviceid": "50081", "system.serial": "41234", "version": "7.38", "system.axiscount": "1"},
            2: {"deviceid": "30342", "system.serial": "56789", "version": "7.38", "system.axiscount": "2"},
        }
        self.received: list[str] = []  # commands, without address, id and checksum
        self.refused: dict[str, str] = {}  # start of a command -> reason
        self.silent = False
        self.n_heard = 0  # lines, answered or not
        self.unanswered: set[str] = set()  # starts of lines that are not answered, each once
        self.n_spoiled = 0  # so many replies from now get a wrong checksum
        self.speaks_grbl = False
        self.clock = DoubleClock()  # for the driver: a busy computer slows it down with the devices
        self.waits_after = inf  # its time at which it stands still until it is told to stop
        self.time = 0.0  # seconds in which an axis moved: what a busy computer does later takes none of it
        self._pace = pace
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._live, daemon=True)

    def __enter__(self) -> ZaberDouble:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()

    def unplug(self) -> None:
        self._ended.set()
        self._thread.join()
        self.clock.end()
        for end in (self._master, self._slave):
            with suppress(OSError):
                os.close(end)

    def moves(self) -> bool:
        return any(axis.is_busy(self.time) for axis in self.axes.values())

    def waits(self) -> bool:
        """Whether it is on its way and waits there to be told to stop; see `waits_after`."""
        return self.moves() and self.time >= self.waits_after

    def did(self, start: str) -> list[str]:
        """Return the commands that began so."""
        return [command for command in self.received if command.startswith(start)]

    def _live(self) -> None:
        line = b""
        while not self._ended.is_set():
            has_bytes = select.select([self._master], [], [], _TICK)[0]
            passed = self._pace * self.clock.tick()
            if self.moves():
                self.time = min(self.time + passed, max(self.time, self.waits_after))
            if not has_bytes:
                continue
            line += os.read(self._master, 1024)
            *lines, line = line.split(b"\n")
            for whole in lines:
                self._hear(whole.decode("ascii").strip())

    def _hear(self, line: str) -> None:
        self.n_heard += 1
        if self.speaks_grbl:
            os.write(self._master, b"error:2\r\n")
            return
        found = _COMMAND.fullmatch(line)
        if self.silent or found is None or _checksum(line[1:-3]) != found[5]:
            return
        address, number, command = int(found[1]), int(found[2]), found[4] or ""
        for start in [start for start in self.unanswered if line.startswith(start)]:
            self.unanswered.remove(start)
            return
        self.received.append(command)
        for device in self.device_settings if address == 0 else {address} & set(self.device_settings):
            self._answer(device, number, found[3], command)

    def _answer(self, address: int, number: int, message_id: str, command: str) -> None:
        places = [place for place in self.axes if place[0] == address and number in (0, place[1])]
        try:
            if not places:
                raise _RefusedError("BADAXIS")
            verdict, data = "OK", self._obey(address, places, command)
        except _RefusedError as error:
            verdict, data = "RJ", str(error)
        axes, now = [self.axes[place] for place in places], self.time
        status = "BUSY" if any(axis.is_busy(now) for axis in axes) else "IDLE"
        flag = _gravest(set().union(*(axis.flags for axis in axes)))
        reply = f"{address:02d} {number} {message_id} {verdict} {status} {flag} {data}"
        checksum = _checksum(reply)
        if self.n_spoiled:
            self.n_spoiled, checksum = self.n_spoiled - 1, "00" if checksum != "00" else "01"
        os.write(self._master, f"@{reply}:{checksum}\r\n".encode())

    def _obey(self, address: int, places: list[tuple[int, int]], command: str) -> str:
        for start, reason in self.refused.items():
            if command.startswith(start):
                raise _RefusedError(reason)
        axes, now = [self.axes[place] for place in places], self.time
        match command.split():
            case []:
                return "0"
            case ["get", name]:
                return self._setting(address, axes, name)
            case ["stop"]:
                if any(axis.is_busy(now) for axis in axes):
                    self.waits_after = inf
                for axis in axes:
                    axis.stop(now)
            case ["home"]:
                for axis in axes:
                    _check_enabled(axis)
                    axis.home(now)
            case ["move", "abs", target]:
                for axis in axes:
                    _move(axis, now, target)
            case ["warnings"]:
                return _listed(set().union(*(axis.flags for axis in axes)))
            case ["warnings", "clear"]:
                flags = _listed(set().union(*(axis.flags for axis in axes)))
                for axis in axes:
                    # What lasts, such as a driver that is disabled, stays.
                    axis.flags -= {"FS", "FE", "WL", "WS", "WM", "NI"}
                return flags
            case _:
                raise _RefusedError("BADCOMMAND")
        return "0"

    def _setting(self, address: int, axes: list[AxisMachine], name: str) -> str:
        if name in self.device_settings[address]:
            return self.device_settings[address][name]
        if name == "pos":
            return " ".join(str(round(axis.position(self.time))) for axis in axes)
        if all(name in axis.settings for axis in axes):
            return " ".join(f"{axis.settings[name]:g}" for axis in axes)
        raise _RefusedError("BADCOMMAND")


def _move(axis: AxisMachine, now: float, target: str) -> None:
    _check_enabled(axis)
    if not re.fullmatch(r"-?\d+", target):
        raise _RefusedError("BADDATA")
    if not axis.settings["limit.min"] <= int(target) <= axis.settings["limit.max"]:
        raise _RefusedError("BADDATA")
    axis.move(now, float(target))


def _check_enabled(axis: AxisMachine) -> None:
    if axis.flags & {"FD", "FO"}:
        raise _RefusedError("DRIVERDISABLED")


def _checksum(text: str) -> str:
    # Least significant byte of the negative sum of all that stands between the first character and the colon.
    return f"{-sum(text.encode('ascii')) & 0xFF:02X}"


def _gravest(flags: set[str]) -> str:
    return min(flags, key=_GRAVEST.index, default="--")


def _listed(flags: set[str]) -> str:
    return " ".join([f"{len(flags):02d}", *sorted(flags, key=_GRAVEST.index)])
