"""How the axes of a stage hang on a GRBL controller: what rig.toml says of it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Literal

from pydantic import Field, model_validator

from drivers.axes.settings import AxisSettings, Name, axes_problems
from drivers.device_settings import DeviceSettings

LETTERS = "XYZABCUV"


class GrblAxis(AxisSettings):
    """One axis and the letter that moves it; the firmware calls its units millimetres."""

    letter: Literal["X", "Y", "Z", "A", "B", "C", "U", "V"] = Field(description="of the firmware")
    scale: float = Field(
        default=1.0,
        description="units of the firmware (its mm) per degree or millimetre; negative turns the sense round",
    )

    steps_per_unit: float | None = Field(
        default=None,
        gt=0.0,
        description="$100 and its like of the firmware, to find out when it has lost its settings; none: not compared",
    )

    @property
    def i_letter(self) -> int:
        """Where the axis stands in the reports and settings of the firmware."""
        return LETTERS.index(self.letter)

    def machine_from_position(self, position: float) -> float:
        """Return the machine position, in the firmware's units, to the three decimals that it takes."""
        return round(self.zero + self.scale * position, 3) + 0.0


class GrblSettings(DeviceSettings):
    """`[stage.device]` of a GRBL stage."""

    port: Name = Field(description="of the system, e.g. /dev/serial/by-id/usb-...")
    axes: tuple[GrblAxis, ...] = Field(description="from the base to the sample")
    baud_rate: int = Field(default=115200, ge=300, le=4_000_000, description="of the firmware; 115200 for GRBL 1.1")
    homing: bool = Field(
        default=True,
        description="true: limit switches find the zero ($22=1); false: it is where the axes stood at power-up",
    )
    settling_time_s: float = Field(
        default=0.2, ge=0.0, le=60.0, description="that the stage stands still before a move counts as done"
    )

    @model_validator(mode="after")
    def _axes_differ(self) -> GrblSettings:
        problems = [*axes_problems(self.axes), *self._letters_twice()]
        if problems:
            raise ValueError("; ".join(problems))
        return self

    def _letters_twice(self) -> Iterator[str]:
        letters = [axis.letter for axis in self.axes]
        twice = (letter for letter in dict.fromkeys(letters) if letters.count(letter) > 1)
        yield from (f"the letter of two axes is {letter}" for letter in twice)
