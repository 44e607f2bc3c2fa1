"""The SDK's messages: controls made from settings, frames and what they tell."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError
from drivers.oak.raw import counts_from_bytes
from drivers.oak.settings import OakSettings

# Types of raw frames -> bits of a count; a RAW16 holds any of them.
_BITS = {"RAW8": 8, "RAW10": 10, "RAW12": 12, "RAW14": 14, "PACK10": 10, "PACK12": 12}


@dataclass(frozen=True, slots=True)
class FrameFacts:
    """What a frame tells of itself.

    Attributes
    ----------
    sequence_number : int
        Counts the sensor's frames, which nobody triggers.
    began : float
        Seconds on the SDK's clock when its exposure began.
    exposure_time : float
        Seconds.
    iso : int
    white_balance_k : int
    sensor_temperature : float
        Degrees Celsius; NaN where it does not tell.
    """

    sequence_number: int
    began: float
    exposure_time: float
    iso: int
    white_balance_k: int
    sensor_temperature: float

    @classmethod
    def of(cls, sdk: Any, frame: Any) -> FrameFacts:
        """Read them off a `depthai.ImgFrame`."""
        temperature = frame.getSensorTemperature()
        return cls(
            sequence_number=int(frame.getSequenceNum()),
            began=frame.getTimestamp(sdk.CameraExposureOffset.START).total_seconds(),
            exposure_time=frame.getExposureTime().total_seconds(),
            iso=int(frame.getSensitivity()),
            white_balance_k=int(frame.getColorTemperature()),
            sensor_temperature=float("nan") if temperature is None else float(temperature),
        )


def now(sdk: Any) -> float:
    """Return the seconds on the clock that the frames' times are told by."""
    return float(sdk.Clock.now().total_seconds())


def set_controls(sdk: Any, control: Any, settings: OakSettings, exposure_time: float) -> Any:
    """Fill in a `depthai.CameraControl`: all that a scene needs, nothing of it automatic; return it.

    Parameters
    ----------
    exposure_time : float
        Seconds; the SDK takes whole microseconds.
    """
    control.setManualExposure(round(exposure_time * 1e6), settings.iso)
    control.setManualWhiteBalance(settings.white_balance_k)
    control.setAntiBandingMode(sdk.CameraControl.AntiBandingMode.OFF)
    control.setAutoFocusMode(sdk.CameraControl.AutoFocusMode.OFF)
    if settings.lens_position is not None:
        control.setManualFocus(settings.lens_position)
    return control


def counts(frame: Any, height: int, width: int, bit_depth: int) -> NDArray[np.uint16]:
    """Return the counts of a raw `depthai.ImgFrame`.

    Returns
    -------
    ndarray of uint16, shape (height, width)

    Raises
    ------
    DeviceError
        If it is no raw frame, or none of that size and depth.
    """
    kind = frame.getType().name
    if kind != "RAW16" and _BITS.get(kind) != bit_depth:
        raise DeviceError(f"a frame is {kind}; expected was a raw one with {bit_depth} bits. Correct bit_depth")
    size = (int(frame.getWidth()), int(frame.getHeight()))
    if size != (width, height):
        raise DeviceError(
            f"a frame is {size[0]} x {size[1]}; expected was {width} x {height}. Correct width and height of [camera]"
        )
    return counts_from_bytes(np.asarray(frame.getData(), np.uint8), height, width, int(frame.getStride()), bit_depth)
