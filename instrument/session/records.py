"""Records that a session file holds, as values."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite, nan
from typing import Literal

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True)
class Board:
    """A marker board in the sample plane.

    Attributes
    ----------
    kind : str
        ``"charuco"`` or ``"checkerboard"``.
    dictionary : str
        OpenCV's name of the marker dictionary; ``""`` for a checkerboard.
    first_id : int
        Number of its first marker; 0 for a checkerboard.
    squares : tuple of int
        Squares across and down.
    square_mm, marker_mm : float
        Sides in millimetres; a checkerboard's marker is 0.
    corner_mm : tuple of float
        x and y of the top left corner in the sample frame (x right, y up); NaN = to be measured.
    """

    kind: str
    dictionary: str
    first_id: int
    squares: tuple[int, int]
    square_mm: float
    marker_mm: float
    corner_mm: tuple[float, float]

    @property
    def is_placed(self) -> bool:
        """Whether somebody stated where it lies."""
        return all(map(isfinite, self.corner_mm))


@dataclass(frozen=True, slots=True)
class AxisRecord:
    """An axis of the stage that carried the sample.

    Attributes
    ----------
    name : str
    kind : {"rotation", "translation"}
        Degrees or millimetres.
    low, high : float
        Range of positions, ends included.
    tolerance : float
        Largest difference between target and read-back that counted as arrived.
    vector : tuple of float, length 3
        Unit vector of the axis, in the frame of the axis it rides on.
    """

    name: str
    kind: Literal["rotation", "translation"]
    low: float
    high: float
    tolerance: float
    vector: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class CameraRecord:
    """The camera that took a session.

    Attributes
    ----------
    height, width : int
        Pixels of a raw frame.
    n_channels : int
        1 for a mosaic or a monochrome frame, 3 for one that holds red, green and blue at every pixel.
    dtype : str
        ``"u2"`` for counts, ``"f4"`` for pictures that came as floating-point numbers.
    bit_depth : int
        Bits of a count, right-aligned.
    black_level, saturation_value : float
        Nominal counts of darkness and of clipping; infinity where nothing clips.
    bayer_pattern : str
        Colours of the 2 x 2 cell in reading order; ``""`` where there is no mosaic.
    conversion_gain : float
        Electrons per count; NaN if not known.
    read_noise : float
        Standard deviation of the read-out in electrons; NaN if not known.
    """

    make: str
    model: str
    serial_number: str
    height: int
    width: int
    n_channels: int
    dtype: str
    bit_depth: int
    black_level: float
    saturation_value: float
    bayer_pattern: str
    conversion_gain: float
    read_noise: float

    @property
    def frame_shape(self) -> tuple[int, ...]:
        """Shape of a frame: (H, W), or (H, W, 3)."""
        size = (self.height, self.width)
        return size if self.n_channels == 1 else (*size, self.n_channels)


@dataclass(frozen=True, slots=True)
class Geometry:
    """How sample, lens and light stand to each other, as stated; None = not stated.

    Attributes
    ----------
    area_mm : tuple of float
        Width and height of the area to reconstruct.
    working_distance_mm : float
        Lens to sample.
    focal_length_px : float
        Pixels.
    light_offset_mm, light_offset_sigma_mm : tuple of float
        Of the light from the lens in the camera frame (x right, y down, z forward), and its standard deviation.
    """

    area_mm: tuple[float, float] | None = None
    working_distance_mm: float | None = None
    focal_length_px: float | None = None
    light_offset_mm: tuple[float, float, float] | None = None
    light_offset_sigma_mm: tuple[float, float, float] | None = None


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
