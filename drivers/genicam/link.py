"""What the driver asks of the library that talks to the camera; the one that does is `drivers.genicam.aravis`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, NamedTuple, Protocol, TypeAlias

Number = Literal["exposure_time", "gain", "black_level"]
"""In seconds, in the unit that `GenicamLink.unit` tells, and in the camera's own."""

Value: TypeAlias = str | bool | float
"""Of a choice or text, a flag, or a number."""

Side = Literal["width", "height", "x_offset", "y_offset"]


@dataclass(frozen=True, slots=True)
class Identity:
    """What a camera says that it is; ``""`` where it does not."""

    make: str
    model: str
    serial_number: str
    firmware: str = ""


class Region(NamedTuple):
    """The part of the sensor that is read, in pixels."""

    x: int
    y: int
    width: int
    height: int


class Steps(NamedTuple):
    """Whole numbers that a camera allows: from `low` in steps to `high`."""

    low: int
    high: int
    step: int


@dataclass(frozen=True, slots=True)
class RawFrame:
    """A frame as it arrived.

    Attributes
    ----------
    frame_id : int
        The camera's own; means nothing where `fault` is set.
    fault : str
        What it lacks; ``""`` when it is whole.
    data : bytes
        Empty where `fault` is set.
    """

    frame_id: int
    fault: str
    data: bytes


class GenicamLink(Protocol):
    """An open camera. Every method raises a `drivers.errors.DeviceError` when the camera or the library fails."""

    @property
    def identity(self) -> Identity:
        """What the camera is."""

    def close(self) -> None:
        """Give the camera back; safe to call twice."""

    def has(self, feature: str) -> bool:
        """Whether the camera has a feature of that name of GenICam's Standard Features Naming Convention."""

    def text(self, feature: str) -> str:
        """Return the value of a text or a choice."""

    def set_text(self, feature: str, value: str) -> None:
        """Set a text or a choice."""

    def choices(self, feature: str) -> tuple[str, ...]:
        """Return what a choice can be."""

    def value(self, feature: str) -> Value:
        """Return the value of a feature of any kind; a whole number as a float."""

    def set_value(self, feature: str, value: Value) -> None:
        """Set a feature to a value of its own kind."""

    def has_number(self, name: Number) -> bool:
        """Whether the camera has that number under any of its names."""

    def number(self, name: Number) -> float:
        """Return a number."""

    def set_number(self, name: Number, value: float) -> None:
        """Set a number; what the camera makes of it only `number` tells."""

    def bounds(self, name: Number) -> tuple[float, float]:
        """Return lowest and highest value of a number."""

    def unit(self, name: Number) -> str:
        """Return the unit of a number; ``""`` where the camera tells none."""

    def temperature(self) -> float:
        """Return the sensor's in degrees Celsius; NaN where the camera tells none."""

    def steps(self, side: Side) -> Steps:
        """Return what a side of the region can be."""

    def region(self) -> Region:
        """Return the part of the sensor that is read."""

    def set_region(self, region: Region) -> None:
        """Set the part of the sensor that is read, all of it, at full resolution."""

    def start(self) -> None:
        """Wait for software triggers from now on; no frame of before arrives any more."""

    def stop(self) -> None:
        """End any exposure, and wait for triggers no more; safe to call twice."""

    def trigger(self) -> None:
        """Begin one exposure."""

    def frame(self, seconds: float) -> RawFrame | None:
        """Return the next frame, or None if none arrives in time."""

    def check_presence(self) -> None:
        """Raise a `drivers.errors.DeviceLostError` unless the camera answers and is still ours."""
