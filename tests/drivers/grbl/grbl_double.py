"""A double of a GRBL 1.1 controller on a pseudo-terminal.

After the firmware's documentation (interface, commands, jogging, settings): strict where the firmware is, with its
quirks. Faults of the wire and the machine are injected by its methods and attributes.
"""

from __future__ import annotations

import os
import re
import select
import threading
import time
import tty
from collections import deque
from contextlib import suppress
from math import inf

from tests.drivers.double_clock import DoubleClock
from tests.drivers.grbl.grbl_machine import GrblMachine

_TICK = 0.002  # seconds
_MAX_STEP = 0.005  # seconds of the machine
_SETTINGS = {
    0: 10,
    1: 25,
    2: 0,
    3: 0,
    4: 0,
    5: 0,
    6: 0,
    10: 1,
    11: 0.010,
    12: 0.002,
    13: 0,
    20: 1,
    21: 0,
    22: 1,
    23: 0,
    24: 300.0,
    25: 3000.0,
    26: 25,
    27: 1.0,
    30: 1000,
    31: 0,
    32: 0,
    **{100 + i: 100.0 for i in range(3)},
    **{110 + i: 2400.0 for i in range(3)},
    **{120 + i: 400.0 for i in range(3)},
    **{130 + i: 200.0 for i in range(3)},
}
_WHOLE = frozenset({0, 1, 2, 3, 4, 5, 6, 10, 13, 20, 21, 22, 23, 26, 30, 31, 32})
_REALTIME = b"?!~\x18\x84\x85"
_WORDS = re.compile(r"([A-Z])(-?\d*\.?\d+)")
_LINE_BUFFER = 80
# Modal groups: more than one word of a group in a line is error:21.
_GROUPS = ({"G0", "G1"}, {"G90", "G91"}, {"G20", "G21"}, {"G93", "G94"}, {"G4", "G53", "G92"})
_KNOWN = set().union(*_GROUPS)


class _AnsweredError(Exception):
    """Ends a line with an error number."""


class GrblDouble:
    """Start it with ``with``; `port` is the name to open.

    Parameters
    ----------
    pace : float
        Seconds of the machine that pass in a second.
    homed : bool
        False: as after power-up with homing enabled, locked.
    settings : mapping of int to float, optional
        That differ from the usual ones.
    """

    def __init__(self, pace: float = 50.0, homed: bool = True, settings: dict[int, float] | None = None) -> None:
        self.settings = {**_SETTINGS, **(settings or {})}
        self.machine = GrblMachine(self.settings)
        self.machine.position = [-100.0, -100.0, 0.0]  # somewhere in its travel
        self.state = "Idle" if homed or not self.settings[22] else "Alarm"
        self.banner = "Grbl 1.1h ['$' for help]"
        self.build = ["[VER:1.1h.20190830:bench 7]", "[OPT:V,15,128]"]
        self.offset = [0.0, 0.0, 0.0]  # WCO
        self.clock = DoubleClock()  # for the driver: a busy computer slows it down with the machine
        self.time = 0.0  # seconds of the machine in which it had something to do: nobody's delay counts
        self.waits_after = inf  # seconds of motion or homing after which time stands still until it is told something
        self.received: list[str] = []  # lines, and the characters that act at once
        # Faults of the wire.
        self.silent = False
        self.delay = 0.0  # seconds before each answer
        self.holds_back = False  # the last line stays inside until the next byte comes
        self.spoiled: dict[str, bytes] = {}  # start of a line -> what is sent in its place, once
        self.spoiled_at: tuple[int, bytes] | None = None  # so many lines from now, and what is sent in its place
        self.refused: dict[str, int] = {}  # start of a line -> error number that answers it
        # Faults of the machine.
        self.switch_is_missing = False
        self.loses_steps = 0.0  # units, at the end of each motion
        self.pace = pace
        self._blocked = ""  # "", "dwell", "home", "critical"
        self._until = 0.0
        self._in_motion = 0.0  # seconds since `waits_after` was heeded last
        self._n_taken = self._n_sent = 0  # bytes
        self._modes = {"motion": "G0", "distance": "G90", "units": "G21"}
        self._feed = 0.0
        self._line = b""
        self._lines: deque[str] = deque()
        self._kept = b""
        self._n_reports = 0
        self._master, self._slave = os.openpty()
        tty.setraw(self._slave)
        self.port = os.ttyname(self._slave)
        self._ended = threading.Event()
        self._guard = threading.RLock()
        self._thread = threading.Thread(target=self._live, daemon=True)

    def __enter__(self) -> GrblDouble:
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.unplug()

    # What a test does to it.

    def unplug(self) -> None:
        """Pull the plug: the port is gone."""
        if not self._ended.is_set():
            self._ended.set()
            self._thread.join()
            self.clock.end()
            os.close(self._master)
            os.close(self._slave)

    def power_cycle(self) -> None:
        """Switch off and on."""
        with self._guard:
            self.machine.cut()
            self.machine.position = [0.0, 0.0, 0.0]
            self.state = "Alarm" if self.settings[22] else "Idle"
            self._start_up()

    def press_limit_switch(self) -> None:
        """Hit a hard limit."""
        with self._guard:
            self._critical(1)

    def jog(self, line: str) -> None:
        """Jog from a pendant, as after ``$J=``."""
        with self._guard:
            self._execute_g_code(line, is_jog=True)

    def open_door(self) -> None:
        with self._guard:
            self.machine.cut()
            self._say("[MSG:Check Door]")
            self.state = "Door:1"

    def say(self, raw: bytes) -> None:
        """Send bytes that nobody asked for."""
        with self._guard:
            self._write(raw)

    def moves(self) -> bool:
        with self._guard:
            return self.machine.moving

    def waits(self) -> bool:
        """Whether it is on its way and waits there to be told something; see `waits_after`."""
        with self._guard:
            return self._is_on_its_way() and self._in_motion >= self.waits_after

    def go_on(self) -> None:
        """Wait no longer."""
        with self._guard:
            self.waits_after, self._in_motion = inf, 0.0

    def exchanged(self) -> tuple[int, int]:
        """Return how many bytes it has taken and acted on, and how many it has sent."""
        with self._guard:
            return self._n_taken, self._n_sent

    # Its life.

    def _live(self) -> None:
        while not self._ended.is_set():
            ready, _, _ = select.select([self._master], [], [], _TICK)
            with self._guard:
                left = self.clock.tick() * self.pace
                while left > 0.0:
                    self._pass_time(min(left, _MAX_STEP))
                    left -= _MAX_STEP
                if ready:
                    with suppress(OSError):
                        self._take(os.read(self._master, 4096))
                self._execute_lines()

    def _pass_time(self, seconds: float) -> None:
        if self._is_on_its_way():
            if self._in_motion >= self.waits_after:
                return
            self._in_motion += seconds
        if self.machine.queue or self._blocked in {"dwell", "home"}:
            self.time += seconds
        self.machine.pass_time(seconds)
        resting = not self.machine.queue
        if self._blocked != "dwell" or resting:
            self._until -= seconds
        if self.state == "Hold:1" and not self.machine.moving:
            self.state = "Hold:0"
        elif self.state in {"Run", "Jog"} and self.machine.braking and not self.machine.moving:
            # A jog that was cancelled; nothing of it is left.
            self.machine.cut()
            self.state = "Idle"
        elif self.state in {"Run", "Jog"} and resting:
            self.machine.position[0] -= self.loses_steps
            self.state = "Idle"
        elif self.state == "Idle" and not resting and self._blocked != "home":
            self.state = "Run"
        if self._blocked == "dwell" and resting and self.state == "Idle" and self._until <= 0.0:
            self._unblock()
        if self._blocked == "home" and self._until <= 0.0:
            self._end_homing()

    def _is_on_its_way(self) -> bool:
        return self.machine.moving or self._blocked == "home"

    def _take(self, received: bytes) -> None:
        self._n_taken += len(received)
        for byte in received:
            kept, self._kept = self._kept, b""
            self._send(kept)
            character = bytes([byte])
            if character in _REALTIME:
                self.received.append(repr(character)[2:-1])
                self._act(character)
            elif byte >= 0x80:
                continue  # the other overrides, which no motion of ours heeds
            elif character in b"\r\n":
                line = self._line.decode("ascii")
                self.received.append(line)
                self._lines.append(line)
                self._line = b""
            elif byte > 0x20:
                self._line += character.upper()

    def _act(self, character: bytes) -> None:
        if self._blocked in {"home", "critical"} and character != b"\x18":
            return  # deaf to all but a reset
        if character == b"?":
            self._report()
            return
        self.go_on()
        if character == b"\x18":
            self._reset()
        elif character == b"!" or (character == b"\x85" and self.state == "Jog"):
            self._hold()
        elif character == b"~" and self.state == "Hold:0":
            self.machine.braking = False
            self.state = "Run" if self.machine.queue else "Idle"
        elif character == b"\x84":
            self.open_door()

    def _hold(self) -> None:
        if self.state in {"Run", "Jog"}:
            self.machine.braking = True
        if self.state == "Run":
            self.state = "Hold:1"
        elif self.state == "Idle":
            # A quirk: a hold at rest is a hold all the same, and has to be left again.
            self.machine.braking = True
            self.state = "Hold:0"

    def _reset(self) -> None:
        in_motion = self.machine.moving
        if self._blocked == "home":
            self._say("ALARM:6")
            self.state = "Alarm"
        elif in_motion:
            self._say("ALARM:3")
            self.state = "Alarm"
        if self._blocked:
            # A quirk: the line that was at work is answered after its end.
            self._say("ok")
        self.machine.cut()
        self._start_up()

    def _start_up(self) -> None:
        self._blocked, self._line, self._n_reports = "", b"", 0
        self._lines.clear()
        self._modes = {"motion": "G0", "distance": "G90", "units": "G21"}
        self._feed = 0.0
        self._write(f"\r\n{self.banner}\r\n".encode())
        if self.state in {"Alarm", "Sleep"}:
            self.state = "Alarm"
            self._say("[MSG:'$H'|'$X' to unlock]")
        else:
            self.state = "Idle"

    def _critical(self, number: int) -> None:
        self.machine.cut()
        self.state, self._blocked = "Alarm", "critical"
        self._say(f"ALARM:{number}")
        self._say("[MSG:Reset to continue]")

    def _execute_lines(self) -> None:
        while self._lines and not self._blocked and not self.state.startswith(("Hold", "Door", "Sleep")):
            try:
                self._execute(self._lines.popleft())
            except _AnsweredError as error:
                self._say(f"error:{error}")
            else:
                if not self._blocked:
                    self._say("ok")

    def _unblock(self) -> None:
        self._blocked = ""
        self._say("ok")

    def _execute(self, line: str) -> None:
        for start, number in self.refused.items():
            if line.startswith(start):
                raise _AnsweredError(number)
        if len(line) >= _LINE_BUFFER:
            raise _AnsweredError(11)
        if line.startswith("$"):
            self._execute_system(line)
        elif line and self.state in {"Alarm", "Jog"}:
            raise _AnsweredError(9)
        elif line:
            self._execute_g_code(line, is_jog=False)

    def _execute_system(self, line: str) -> None:
        at_rest = self.state in {"Idle", "Alarm"}
        if line.startswith("$J="):
            if self.state not in {"Idle", "Jog"}:
                raise _AnsweredError(8)
            self._execute_g_code(line[3:], is_jog=True)
        elif line == "$X":
            if self.state == "Alarm":
                self._say("[MSG:Caution: Unlocked]")
                self.state = "Idle"
        elif line == "$$" and self.state not in {"Run", "Hold:0", "Hold:1"}:
            self._dump()
        elif line in {"$$", "$H", "$I", "$SLP"} and not at_rest:
            raise _AnsweredError(8)
        elif line == "$I":
            for text in self.build:
                self._say(text)
        elif line == "$H":
            self._begin_homing()
        elif line == "$SLP":
            self._say("[MSG:Sleeping]")
            self.state = "Sleep"
        elif match := re.fullmatch(r"\$(\d+)=([\d.]+)", line):
            self.settings[int(match[1])] = float(match[2])
        else:
            raise _AnsweredError(3)

    def _dump(self) -> None:
        for number, value in self.settings.items():
            self._say(f"${number}={value:.0f}" if number in _WHOLE else f"${number}={value:.3f}")

    def _begin_homing(self) -> None:
        if not self.settings[22]:
            raise _AnsweredError(5)
        # Nothing is reported on the way; the double comes to the switch after a fixed time.
        self.state, self._blocked, self._until = "Home", "home", 5.0

    def _end_homing(self) -> None:
        if self.switch_is_missing:
            self.state = "Alarm"
            self._say("ALARM:9")
            self._say("ok")
            self._start_up()
            return
        pull_off, mask = self.settings[27], int(self.settings[23])
        for i in range(3):
            self.machine.position[i] = pull_off - self.settings[130 + i] if mask >> i & 1 else -pull_off
        self.state = "Idle"
        self._unblock()

    def _execute_g_code(self, line: str, *, is_jog: bool) -> None:
        words = self._words(line)
        commands = {f"{letter}{value:g}" for letter, value in words if letter == "G"}
        values = {letter: value for letter, value in words if letter != "G"}
        modes = dict(self._modes)
        for mode, group in (("motion", _GROUPS[0]), ("distance", _GROUPS[1]), ("units", _GROUPS[2])):
            modes[mode] = next(iter(commands & group), modes[mode])
        feed = values.get("F", 0.0 if is_jog else self._feed) * _inches(modes)
        if not is_jog:
            self._modes, self._feed = modes, feed
        if "G4" in commands:
            if "P" not in values:
                raise _AnsweredError(28)
            self._blocked, self._until = "dwell", values["P"]
            return
        axes = {letter: values[letter] for letter in "XYZ" if letter in values}
        if set(values) - set("XYZFN"):
            raise _AnsweredError(36)
        if axes:
            if feed <= 0.0 and (is_jog or modes["motion"] == "G1"):
                raise _AnsweredError(22)
            rate = feed / 60.0 if is_jog or modes["motion"] == "G1" else 1e9
            self._plan(self._target(axes, commands, modes), rate, is_jog=is_jog)
        elif "G53" in commands or is_jog:
            raise _AnsweredError(26)

    def _words(self, line: str) -> list[tuple[str, float]]:
        if "".join(match[0] for match in _WORDS.finditer(line)) != line:
            raise _AnsweredError(1 if not line[0].isalpha() else 2)
        words = [(letter, float(value)) for letter, value in _WORDS.findall(line)]
        commands = [f"G{value:g}" for letter, value in words if letter == "G"]
        if set(commands) - _KNOWN:
            raise _AnsweredError(20)
        if any(len([c for c in commands if c in group]) > 1 for group in _GROUPS):
            raise _AnsweredError(21)
        others = [letter for letter, _ in words if letter != "G"]
        if len(others) != len(set(others)):
            raise _AnsweredError(25)
        return words

    def _target(self, axes: dict[str, float], commands: set[str], modes: dict[str, str]) -> list[float]:
        start = self.machine.queue[-1][0] if self.machine.queue else self.machine.position
        target = list(start)
        for letter, number in axes.items():
            i, value = "XYZ".index(letter), number * _inches(modes)
            if modes["distance"] == "G91":
                target[i] = start[i] + value
            else:
                target[i] = value + (0.0 if "G53" in commands else self.offset[i])
        # Whole steps.
        return [round(part * self.settings[100 + i]) / self.settings[100 + i] for i, part in enumerate(target)]

    def _plan(self, target: list[float], feed: float, *, is_jog: bool) -> None:
        if self.settings[20] and not all(-self.settings[130 + i] <= part <= 0.0 for i, part in enumerate(target)):
            if is_jog:
                raise _AnsweredError(15)
            self._critical(2)
            return
        self.machine.queue.append((target, feed))
        if is_jog:
            # A jog is one before it is answered; a line of G-code begins a moment after its answer.
            self.state = "Jog"

    def _report(self) -> None:
        kind = "MPos" if int(self.settings[10]) & 1 else "WPos"
        shown = self.machine.position
        if kind == "WPos":
            shown = [m - o for m, o in zip(self.machine.position, self.offset, strict=True)]
        scale = 1.0 / 25.4 if self.settings[13] else 1.0
        text = f"<{self.state}|{kind}:{_numbers(shown, scale)}|FS:{60.0 * self.machine.speed:.0f},0"
        if self._n_reports % 10 == 0:
            text += f"|WCO:{_numbers(self.offset, scale)}"
        elif self._n_reports % 10 == 1:
            text += "|Ov:100,100,100"
        self._n_reports += 1
        self._say(text + ">")

    def _say(self, text: str) -> None:
        for start in [start for start in self.spoiled if text.startswith(start)]:
            self._write(self.spoiled.pop(start))
            return
        if self.spoiled_at is not None:
            n_lines, raw = self.spoiled_at
            self.spoiled_at = (n_lines - 1, raw) if n_lines else None
            if n_lines == 0:
                self._write(raw)
                return
        self._write(text.encode() + b"\r\n")

    def _write(self, raw: bytes) -> None:
        if self.silent:
            return
        time.sleep(self.delay)
        if self.holds_back:
            self._kept, raw = raw, self._kept
        self._send(raw)

    def _send(self, raw: bytes) -> None:
        while raw:
            n_bytes = os.write(self._master, raw)
            self._n_sent += n_bytes
            raw = raw[n_bytes:]


def _inches(modes: dict[str, str]) -> float:
    return 25.4 if modes["units"] == "G20" else 1.0


def _numbers(values: list[float], scale: float) -> str:
    return ",".join(f"{value * scale + 0.0:.3f}" for value in values)
