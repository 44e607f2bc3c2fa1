"""Takes the frames of one pose, and believes nothing that the devices do not confirm."""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.camera import Camera, CameraDescription, Frame
from drivers.errors import DeviceError
from drivers.light import Light, LightState
from drivers.stage import Stage
from instrument.pose_record import PoseRecord
from instrument.rig import Rig

# A camera rounds exposure times to its clock; more than 2 % off is another time than planned.
SETTING_TOLERANCE = 0.02
# A frame must carry the time that was read back, but for the last digits of its metadata.
FRAME_TOLERANCE = 1e-3
# Seconds of lease a frame may take besides its exposure: readout, transfer, a busy computer.
FRAME_MARGIN = 2.0


@dataclass(frozen=True, slots=True)
class Shot:
    """One frame with what the light said and when it had been read (monotonic, ns)."""

    frame: Frame
    light: LightState
    monotonic_ns: int


def take_pose(rig: Rig, target: Mapping[str, float], exposure_times: tuple[float, ...], attempt: int) -> PoseRecord:
    """Move to `target` and take one frame for each exposure time (seconds) in the light.

    Raises
    ------
    DeviceError
        If any device fails or does not confirm what it was told; the light is off then.
    """
    positions = move_verified(rig.stage, target)
    level = rig.config.light.level
    with light_on(rig.light, level, lease_seconds(exposure_times)):
        shots = [take_shot(rig.camera, rig.light, exposure_time) for exposure_time in exposure_times]
    check_order(shots)
    return _record(shots, level, positions, attempt)


def take_darks(rig: Rig, exposure_time: float, count: int) -> tuple[NDArray[np.float32], NDArray[np.float32], int]:
    """Take `count` frames in the dark.

    Returns
    -------
    mean, variance : ndarray of float32, shape (H, W)
        Of the counts; the variance is that of one frame (divided by ``count - 1``).
    monotonic_ns : int
        When the last had been read.
    """
    _confirm_dark(rig.light)
    shape = rig.camera.describe().height, rig.camera.describe().width
    total, squares = np.zeros(shape, np.uint64), np.zeros(shape, np.uint64)
    for _ in range(count):
        counts = _expose(rig.camera, exposure_time).counts.astype(np.uint64)
        # Sums of whole numbers are exact; the stack of frames need not be kept.
        total += counts
        squares += counts * counts
    mean = total / count
    variance = np.maximum(squares - total * mean, 0.0) / (count - 1)
    return mean.astype(np.float32), variance.astype(np.float32), time.monotonic_ns()


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
    if light.off().lit:
        raise DeviceError("the light was told to go dark and still shines. Switch it off by hand")


def _darken(light: Light, error: BaseException) -> None:
    try:
        light.off()
    except Exception as failure:
        error.add_note(f"light off failed: {failure}")


def take_shot(camera: Camera, light: Light, exposure_time: float) -> Shot:
    """Take one frame of `exposure_time` seconds in the light."""
    frame = _expose(camera, exposure_time)
    state = light.read()
    if not state.lit:
        raise DeviceError("the light went dark during the bracket: its lease ended or its supply failed")
    return Shot(frame, state, time.monotonic_ns())


def lease_seconds(exposure_times: tuple[float, ...]) -> float:
    """Return for how many seconds the light may shine by itself over a bracket."""
    return sum(exposure_times) + FRAME_MARGIN * len(exposure_times)


def check_order(shots: list[Shot]) -> None:
    """Raise `DeviceError` unless the frames follow one another without a gap."""
    first = shots[0].frame.sequence_number
    numbers = [shot.frame.sequence_number for shot in shots]
    if numbers != list(range(first, first + len(shots))):
        raise DeviceError(f"a frame was lost or came twice: the camera numbers them {numbers}")


def _expose(camera: Camera, exposure_time: float) -> Frame:
    readback = camera.set_exposure_time(exposure_time)
    _check_close("the camera's exposure time", readback, exposure_time, SETTING_TOLERANCE)
    frame = camera.trigger()
    _check_close("the frame's exposure time", frame.exposure_time, readback, FRAME_TOLERANCE)
    check_frame(frame, camera.describe())
    return frame


def check_frame(frame: Frame, camera: CameraDescription) -> None:
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


def _confirm_dark(light: Light) -> None:
    if light.off().lit:
        raise DeviceError("the light still shines; darks need it off. Switch it off by hand")


def _record(shots: list[Shot], level: float, positions: Mapping[str, float], attempt: int) -> PoseRecord:
    return PoseRecord(
        i_exposure=np.arange(len(shots)),
        counts=np.stack([shot.frame.counts for shot in shots]),
        exposure_readback=np.array([shot.frame.exposure_time for shot in shots]),
        sensor_temperature=np.array([shot.frame.sensor_temperature for shot in shots]),
        monotonic_ns=np.array([shot.monotonic_ns for shot in shots]),
        level_set=level,
        level_readback=np.array([shot.light.level for shot in shots]),
        monitor=np.array([shot.light.monitor for shot in shots]),
        light_temperature=np.array([shot.light.temperature for shot in shots]),
        positions=positions,
        attempts=attempt,
    )
