"""What is measured at one pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import nan

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class PoseRecord:
    """What was measured at one pose.

    Attributes
    ----------
    i_exposure : ndarray of int, shape (K,)
        Which of the plan's exposures were taken, ascending; a pose of an import may lack some.
    counts : ndarray of uint16 or float32, shape (K, H, W) or (K, H, W, 3)
        Raw frames.
    exposure_readback, sensor_temperature : ndarray, shape (K,)
        Seconds and degrees Celsius, as the camera reports them.
    monotonic_ns : ndarray of int64, shape (K,)
        When each frame had been read; 0 = not known.
    level_set : float
        Level of the light that was asked for.
    level_readback, monitor, light_temperature : ndarray, shape (K,)
        What the light reported during each exposure.
    positions : mapping of str to float
        Read-back of each axis in degrees or millimetres.
    attempts : int
        How many times the pose was begun.
    reference : float
        Brightness of the reference patch, counts per second; NaN if not measured.
    """

    i_exposure: NDArray[np.int64]
    counts: NDArray[np.uint16] | NDArray[np.float32]
    exposure_readback: NDArray[np.float64]
    sensor_temperature: NDArray[np.float64]
    monotonic_ns: NDArray[np.int64]
    level_set: float
    level_readback: NDArray[np.float64]
    monitor: NDArray[np.float64]
    light_temperature: NDArray[np.float64]
    positions: Mapping[str, float]
    attempts: int
    reference: float = nan
