"""What the rig file says of a LED driver on a serial port, and of the words that it knows."""

from __future__ import annotations

import re
import string
from typing import Annotated

from pydantic import Field, model_validator

from drivers.device_settings import DeviceSettings
from drivers.lease import LONGEST_LEASE

_COMMANDS = ("identify_command", "level_command", "on_command", "off_command", "state_command")

Text = Annotated[str, Field(min_length=1)]


class SerialLightSettings(DeviceSettings):
    r"""`[light.device]` of a LED driver that answers each line with a line.

    The words are those of docs/light-drivers.md unless the rig file has others.
    """

    port: Text = Field(description="e.g. /dev/serial/by-id/usb-...")
    # An empty identity is contained in every answer: any device would do.
    identity: Text = Field(description="what the answer to identify_command has to contain")
    baud_rate: int = Field(default=115200, ge=300, le=4_000_000, description="from the driver's manual")
    full_level: float = Field(default=100.0, gt=0.0, description="the number that stands for level 1, e.g. 255")
    level_tolerance: float = Field(
        default=0.05,
        ge=0.0,
        description="largest difference of a level read back beyond its own rounding, like full_level",
    )
    identify_command: str = Field(default="ID?", description="a line without its end")
    level_command: str = Field(default="LEVEL {level:.2f}", description="with {level}, which takes a format")
    on_command: str = Field(default="ON", description="a line without its end")
    off_command: str = Field(default="OFF", description="a line without its end")
    state_command: str = Field(default="STATE?", description="a line without its end")
    done: Text = Field(default="OK", description="the answer to a command that was obeyed")
    state: str = Field(
        default=r"(?:(?P<lit>ON)|OFF) (?P<level>\d+(?:\.\d+)?)",
        description="regular expression of the answer to state_command: its group lit matches only when the light "
        "shines, its group level is the number",
    )
    boot_time_s: float = Field(
        default=0.0, ge=0.0, le=30.0, description="until it listens after its port was opened; 2 for an Arduino"
    )
    # A supervisor waits for 4 s: one time limit, and a few more words, have to fit into that.
    answer_time_s: float = Field(default=1.0, ge=0.05, le=1.5, description="that it has for an answer; 1 s is ample")
    longest_lease_s: float = Field(
        default=LONGEST_LEASE, ge=0.001, le=86_400.0, description="that it may be told to shine at a time"
    )

    @model_validator(mode="after")
    def _words_mean_something(self) -> SerialLightSettings:
        problems = [*self._unspeakable(), *self._level_problems(), *self._state_problems()]
        if problems:
            raise ValueError("; ".join(problems))
        return self

    def level_line(self, level: float) -> str:
        """Return the command for a level of 0 to 1."""
        return self.level_command.format(level=level * self.full_level)

    def sent_level(self, level: float) -> float:
        """Return the level that the command says, after the rounding of its format."""
        parts = string.Formatter().parse(self.level_command)
        spec = next(spec for _, name, spec, _ in parts if name is not None)
        try:
            return float(format(level * self.full_level, spec or "")) / self.full_level
        except ValueError:  # a format of words that are no number, such as 1e+02% of {level:.0%}
            return level

    def _unspeakable(self) -> list[str]:
        words = {name: getattr(self, name) for name in _COMMANDS}
        return [
            f"{name} is {word!r}; allowed are printable ASCII characters, one at least"
            for name, word in words.items()
            if not (word and word.isascii() and word.isprintable())
        ]

    def _level_problems(self) -> list[str]:
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
