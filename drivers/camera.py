"""What halfangle asks of a camera."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from drivers.limits import Limits
from drivers.readback import Setting


@dataclass(frozen=True, slots=True)
class CameraDescription:
    """What does not change while a camera is connected.

    Attributes
    ----------
    height, width : int
        Size of a raw frame in pixels.
    bit_depth : int
        Bits of a count as the sensor reads it out; counts are right-aligned in 16 bits.
    black_level, saturation_level : float
        Nominal counts of darkness and of clipping; the analysis measures both again.
    bayer_pattern : str
        Colours of the 2 x 2 cell in reading order, e.g. ``"RGGB"``; ``""`` for monochrome.
    conversion_gain : float
        Electrons per count.
    read_noise : float
        Standard deviation of the read-out in electrons.
    exposure_time_limits : Limits
        Seconds.
    firmware : str
        Its version, as the device says it; ``""`` where it does not.
    settings : tuple of Setting
        What was set when it was connected, as it reads back.
    """

    make: str
    model: str
    serial_number: str
    height: int
    width: int
    bit_depth: int
    black_level: float
    saturation_level: float
    bayer_pattern: str
    conversion_gain: float
    read_noise: float
    exposure_time_limits: Limits
    firmware: str = ""
    settings: tuple[Setting, ...] = ()


@dataclass(frozen=True, slots=True)
class Frame:
    """One exposure as the camera delivered it.

    Attributes
    ----------
    counts : ndarray of uint16, shape (height, width)
        Raw counts; a colour sensor's stay in the Bayer mosaic.
    sequence_number : int
        Counts the camera's triggers since it was connected, from 0.
    exposure_time : float
        Seconds, as the camera reports it for this frame.
    sensor_temperature : float
        Degrees Celsius; NaN where the camera has no sensor for it.
    """

    counts: NDArray[np.uint16]
    sequence_number: int
    exposure_time: float
    sensor_temperature: float


@runtime_checkable
class Camera(Protocol):
    """A camera that takes one raw frame when told to.

    Every method raises `drivers.errors.DeviceError` (or a subclass) when the device fails.
    """

    def connect(self) -> None:
        """Open the device; safe to call twice."""

    def disconnect(self) -> None:
        """Close the device; safe to call twice, and without `connect`."""

    def describe(self) -> CameraDescription:
        """Return what the connected camera is."""

    def set_exposure_time(self, exposure_time: float) -> float:
        """Set the exposure time in seconds; return what the camera reads back.

        Raises
        ------
        DeviceLimitError
            If the camera cannot take that exposure time.
        """

    def trigger(self) -> Frame:
        """Expose once and return the frame; blocks for a bounded time."""

    def stop(self) -> None:
        """End any exposure under way; safe to call at any time."""
