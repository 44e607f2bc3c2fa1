"""Takes dark frames, and frames of an even plane."""

from __future__ import annotations

import time

import numpy as np
from numpy.typing import NDArray

from drivers.errors import UnsafeError
from instrument.rig.rig import Rig
from protocols.acquisition.frame_checks import check_darks, check_order, clips
from protocols.acquisition.shot import confirm_dark, expose, lease_seconds, light_on, take_shot


def take_darks(
    rig: Rig, exposure_time: float, count: int
) -> tuple[NDArray[np.float32], NDArray[np.float32], int, float]:
    """Take `count` frames in the dark.

    Returns
    -------
    mean, variance : ndarray of float32, shape (H, W)
        Of the counts; the variance is that of one frame (divided by ``count - 1``).
    monotonic_ns : int
        When the last had been read.
    temperature : float
        Of the sensor at the last, degrees Celsius.

    Raises
    ------
    UnsafeError
        If the frames are not dark.
    """
    confirm_dark(rig.light)
    camera = rig.camera.describe()
    shape = camera.height, camera.width
    total, squares = np.zeros(shape, np.uint64), np.zeros(shape, np.uint64)
    numbers = []
    for _ in range(count):
        frame = expose(rig.camera, exposure_time)
        numbers.append(frame.sequence_number)
        counts = frame.counts.astype(np.uint64)
        # Sums of whole numbers are exact; the stack of frames need not be kept.
        total += counts
        squares += counts * counts
    check_order(numbers)
    mean = total / count
    variance = np.maximum(squares - total * mean, 0.0) / (count - 1)
    check_darks(mean, camera, exposure_time)
    return mean.astype(np.float32), variance.astype(np.float32), time.monotonic_ns(), frame.sensor_temperature


def take_flats(rig: Rig, exposure_time: float, count: int) -> NDArray[np.uint16]:
    """Take `count` frames of what lies before the lens, in the light; shape (count, H, W), counts.

    Raises
    ------
    DeviceError
        If a device fails.
    UnsafeError
        If they clip.
    """
    times = (exposure_time,) * count
    with light_on(rig.light, rig.config.light.level, lease_seconds(times)):
        shots = [take_shot(rig.camera, rig.light, 0, exposure_time) for _ in times]
    check_order([shot.frame.sequence_number for shot in shots])
    if clips(shots[0].frame, rig.camera.describe()):
        raise UnsafeError(f"the flat frames of {exposure_time:g} s clip. Choose a shorter flats.exposure_time_s")
    return np.stack([shot.frame.counts for shot in shots])
