"""What halfangle asks of a stage."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, Protocol, runtime_checkable

from drivers.limits import Limits
from drivers.readback import Setting


@dataclass(frozen=True, slots=True)
class AxisDescription:
    """One axis of a stage.

    Attributes
    ----------
    name : str
        As used in poses, e.g. ``"tilt"``.
    kind : {"rotation", "translation"}
        Degrees or millimetres.
    soft_limits : Limits
        Range of positions, ends included.
    tolerance : float
        Largest difference between target and read-back that counts as arrived.
    vector : tuple of float, length 3
        Unit vector of the axis (of rotation, right-handed, or of travel), in the frame of the
        axis it rides on.
    """

    name: str
    kind: Literal["rotation", "translation"]
    soft_limits: Limits
    tolerance: float
    vector: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class StageDescription:
    """What does not change while a stage is connected: axes from the base to the sample, `settings` as read back."""

    make: str
    model: str
    serial_number: str
    axes: tuple[AxisDescription, ...]
    firmware: str = ""
    settings: tuple[Setting, ...] = ()


@runtime_checkable
class Stage(Protocol):
    """A stage that carries the sample.

    Every method raises `drivers.errors.DeviceError` (or a subclass) when the device fails.
    """

    def connect(self) -> None:
        """Open the device, at rest; safe to call twice."""

    def disconnect(self) -> None:
        """Stop and close; safe to call twice, and without `connect`."""

    def describe(self) -> StageDescription:
        """Return what the connected stage is."""

    def home(self) -> None:
        """Find the zero of every axis."""

    def move(self, target: Mapping[str, float]) -> dict[str, float]:
        """Move the named axes, wait until they rest, return every axis' read-back.

        Raises
        ------
        DeviceLimitError
            If a target is outside its soft limits; nothing has moved then.
        NotHomedError
            If it finds its zero by switches and has not done so since it was connected.
        """

    def move_duration(self, target: Mapping[str, float]) -> float:
        """Return the seconds that `move` would take from here, settling included."""

    def read(self) -> dict[str, float]:
        """Return the position of every axis as the device reports it."""

    def stop(self) -> None:
        """Halt every axis now; safe to call at any time."""
