"""What the rig file says of a LED driver on a serial port, and of the words that it knows."""

from __future__ import annotations

import re
from dataclasses import dataclass

from drivers.lease import LONGEST_LEASE
from drivers.limits import Limits

# A supervisor waits for 4 s: one time limit, and a few more words, have to fit into that.
ANSWER_TIME = Limits(0.05, 1.5, "s")
LEASE = Limits(0.001, 86_400.0, "s")
BAUD_RATE = Limits(300.0, 4_000_000.0, "baud")
BOOT_TIME = Limits(0.0, 30.0, "s")

_COMMANDS = ("identify_command", "level_command", "on_command", "off_command", "state_command")


@dataclass(frozen=True, slots=True)
class SerialLightSettings:
    r"""A LED driver that answers each line with a line.

    The words are those of docs/light-drivers.md unless the rig file has others.

    Attributes
    ----------
    port : str
        E.g. ``/dev/serial/by-id/usb-...``.
    identity : str
        What the answer to `identify_command` has to contain.
    baud_rate : int
    full_level : float
        The number that stands for level 1, e.g. 255.
    level_tolerance : float
        Largest difference between a level that was set and the one that is read back, counted like `full_level`.
    identify_command, on_command, off_command, state_command : str
        Lines without their end.
    level_command : str
        A line with ``{level}``, which takes a format, e.g. ``LEVEL {level:.0f}``.
    done : str
        The answer to a command that was obeyed.
    state : str
        Regular expression of the answer to `state_command`. Its group ``lit`` matches only when the light shines, its
        group ``level`` is the number.
    boot_time : float
        Seconds until it listens after its port was opened; 2 for an Arduino, which starts anew then.
    answer_time : float
        Seconds that it has for an answer.
    longest_lease : float
        Seconds that it may be told to shine at a time.
    """

    port: str
    identity: str
    baud_rate: int = 115200
    full_level: float = 100.0
    level_tolerance: float = 0.05
    identify_command: str = "ID?"
    level_command: str = "LEVEL {level:.2f}"
    on_command: str = "ON"
    off_command: str = "OFF"
    state_command: str = "STATE?"
    done: str = "OK"
    state: str = r"(?:(?P<lit>ON)|OFF) (?P<level>\d+(?:\.\d+)?)"
    boot_time: float = 0.0
    answer_time: float = 1.0
    longest_lease: float = LONGEST_LEASE

    def __post_init__(self) -> None:
        """Refuse values that no driver takes, and words that mean nothing."""
        ANSWER_TIME.check("answer_time", self.answer_time, "1 s is ample.")
        LEASE.check("longest_lease", self.longest_lease, "Take what one bracket needs.")
        BAUD_RATE.check("baud_rate", self.baud_rate, "Take it from the driver's manual.")
        BOOT_TIME.check("boot_time", self.boot_time, "2 s are enough for an Arduino.")
        problems = [*self._empty(), *self._unspeakable(), *self._level_problems(), *self._state_problems()]
        if problems:
            raise ValueError("; ".join(problems))

    def level_line(self, level: float) -> str:
        """Return the command for a level of 0 to 1."""
        return self.level_command.format(level=level * self.full_level)

    def _empty(self) -> list[str]:
        # An empty identity is contained in every answer: any device would do.
        return [f"{name} is empty" for name in ("port", "identity") if not getattr(self, name)]

    def _unspeakable(self) -> list[str]:
        words = {name: getattr(self, name) for name in _COMMANDS}
        return [
            f"{name} is {word!r}; allowed are printable ASCII characters, one at least"
            for name, word in words.items()
            if not (word and word.isascii() and word.isprintable())
        ]

    def _level_problems(self) -> list[str]:
        if not (self.full_level > 0.0 and self.level_tolerance >= 0.0):
            return ["full_level has to be more than 0, and level_tolerance 0 or more"]
        try:
            differ = self.level_line(0.0) != self.level_line(1.0)
        except (IndexError, KeyError, ValueError) as error:
            return [f"level_command is {self.level_command!r}, which is no format of {{level}}: {error}"]
        return [] if differ else [f"level_command is {self.level_command!r}; it says {{level}} nowhere"]

    def _state_problems(self) -> list[str]:
        try:
            missing = {"lit", "level"} - set(re.compile(self.state).groupindex)
        except re.error as error:
            return [f"state is {self.state!r}, which is no regular expression: {error}"]
        return [f"state is {self.state!r}; it has no group {name!r}" for name in sorted(missing)]
