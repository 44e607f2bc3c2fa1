"""Takes single frames in the light; every setting is confirmed by read-back."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from drivers.camera import Camera, CameraDescription, Frame
from drivers.errors import DeviceError, UnsafeError
from drivers.light import Light, LightState
from drivers.stage import Stage
from instrument.rig.rig import Rig

# A camera rounds exposure times to its clock; more than 2 % off is another time than planned.
SETTING_TOLERANCE = 0.02

# A frame must carry the time that was read back, but for the last digits of its metadata.
FRAME_TOLERANCE = 1e-3

# Seconds of lease a frame may take besides its exposure: readout, transfer, a busy computer.
LEASE_MARGIN = 2.0


@dataclass(frozen=True, slots=True)
class Shot:
    """One frame with what the light said and when it had been read (monotonic, ns)."""

    i_exposure: int
    frame: Frame
    light: LightState
    monotonic_ns: int


def move_verified(stage: Stage, target: Mapping[str, float]) -> dict[str, float]:
    """Move, and return every axis' read-back once it lies within tolerance of its target."""
    stage.move(target)
    positions = stage.read()
    for axis in stage.describe().axes:
        wanted, reached = target.get(axis.name), positions[axis.name]
        # Written so that a NaN fails.
        if wanted is not None and not abs(reached - wanted) <= axis.tolerance:
            raise DeviceError(
                f"axis {axis.name!r} reads {reached:g} {axis.soft_limits.unit} and should be at {wanted:g} "
                f"within {axis.tolerance:g}. Look for an obstacle or a loose belt"
            )
    return positions


@contextmanager
def light_on(light: Light, level: float, max_seconds: float) -> Iterator[None]:
    """Light within the block, dark after it; both confirmed by the light itself."""
    try:
        if not light.on(level, max_seconds).lit:
            raise DeviceError("the light was told to shine and reports that it is dark. Check its supply")
        yield
    except BaseException as error:
        # What went wrong first stays the error, above all a Ctrl-C.
        _darken(light, error)
        raise
    confirm_dark(light)


def _darken(light: Light, error: BaseException) -> None:
    try:
        light.off()
    except Exception as failure:
        error.add_note(f"light off failed: {failure}")


def confirm_dark(light: Light) -> None:
    """Tell the light to go dark; raise `UnsafeError` if it still shines after a second command."""
    # A second command, in case that the first was lost on its way.
    if light.off().lit and light.off().lit:
        raise UnsafeError("the light was told to go dark twice and still shines. Switch it off by hand")


def lease_seconds(exposure_times: tuple[float, ...]) -> float:
    """Return for how many seconds the light may shine by itself over a bracket."""
    return sum(exposure_times) + LEASE_MARGIN * len(exposure_times)


def take_shot(camera: Camera, light: Light, i_exposure: int, exposure_time: float) -> Shot:
    """Take one frame of `exposure_time` seconds in the light."""
    frame = expose(camera, exposure_time)
    state = light.read()
    if not state.lit:
        raise DeviceError("the light went dark during the bracket: its lease ended or its supply failed")
    return Shot(i_exposure, frame, state, time.monotonic_ns())


def expose(camera: Camera, exposure_time: float) -> Frame:
    """Take one frame of `exposure_time` seconds, of the size and setting that were asked for."""
    readback = camera.set_exposure_time(exposure_time)
    _check_close("the camera's exposure time", readback, exposure_time, SETTING_TOLERANCE)
    frame = camera.trigger()
    _check_close("the frame's exposure time", frame.exposure_time, readback, FRAME_TOLERANCE)
    _check_frame(frame, camera.describe())
    return frame


def _check_frame(frame: Frame, camera: CameraDescription) -> None:
    """Raise `DeviceError` unless the frame has the shape and type that the camera describes."""
    expected = (camera.height, camera.width)
    if frame.counts.shape != expected or frame.counts.dtype != np.uint16:
        raise DeviceError(
            f"the camera delivered {frame.counts.dtype} of shape {frame.counts.shape}; "
            f"expected uint16 of shape {expected}"
        )


def _check_close(what: str, value: float, wanted: float, tolerance: float) -> None:
    # Written so that a NaN fails.
    if not abs(value - wanted) <= tolerance * wanted:
        raise DeviceError(
            f"{what} is {value:g} s and should be {wanted:g} s (within {tolerance:.1%}): "
            "a setting that did not take, or a frame of the exposure before"
        )


def take_single_frame(rig: Rig, exposure_time: float) -> Frame:
    """Light on, one exposure, light off.

    Parameters
    ----------
    rig : Rig
        Connected.
    exposure_time : float
        Seconds.

    Raises
    ------
    DeviceError
        If a device does not do it; `DeviceLimitError` where the camera takes no such time.
    """
    with light_on(rig.light, rig.config.light.level, lease_seconds((exposure_time,))):
        return expose(rig.camera, exposure_time)
