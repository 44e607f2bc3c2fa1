"""From light to counts: electrons, their noise, and the converter."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Picture = NDArray[np.float32]

# Above this a Poisson number is normal for every purpose here, and 10 times as fast to draw.
_NORMAL_ABOVE = 50.0
# A white plate (albedo 0.85) that faces the camera at the working distance fills half of the range.
_EXPOSURE_OF_HALF_RANGE = 0.010
_WHITE_ALBEDO = 0.85


@dataclass(frozen=True, slots=True)
class Sensor:
    """A colour sensor behind a 12-bit converter.

    Attributes
    ----------
    bit_depth : int
        Of the converter.
    black_level : float
        Counts of darkness.
    conversion_gain : float
        Electrons per count.
    full_well : float
        Electrons at which a pixel clips; just above the converter's range, as cameras are set up.
    read_noise : float
        Standard deviation, electrons.
    dark_current : float
        Electrons per second.
    prnu : float
        Relative standard deviation of the pixels' sensitivities.
    temperature : float
        Degrees Celsius.
    """

    bit_depth: int = 12
    black_level: float = 64.0
    conversion_gain: float = 2.5
    full_well: float = 10_500.0
    read_noise: float = 3.0
    dark_current: float = 4.0
    prnu: float = 0.005
    temperature: float = 31.0
    bayer_pattern: str = "RGGB"

    @property
    def saturation_level(self) -> float:
        """Largest count."""
        return float((1 << self.bit_depth) - 1)

    def sensitivity(self, working_distance_mm: float) -> float:
        """Return electrons per second and unit of rendered radiance (1/(sr mm^2), light of power 1)."""
        white = _WHITE_ALBEDO / np.pi / working_distance_mm**2
        half_range = 0.5 * (self.saturation_level - self.black_level) * self.conversion_gain
        return float(half_range / _EXPOSURE_OF_HALF_RANGE / white)

    def pixel_response(self, rng: np.random.Generator, height: int, width: int) -> Picture:
        """Return the relative sensitivities of the pixels, shape (height, width)."""
        scatter = rng.standard_normal((height, width), dtype=np.float32)
        return np.float32(1.0) + np.float32(self.prnu) * scatter

    def counts(self, photoelectrons: Picture, exposure_time: float, rng: np.random.Generator) -> NDArray[np.uint16]:
        """Return raw counts.

        Parameters
        ----------
        photoelectrons : ndarray of float32, shape (height, width)
            Expected electrons from light.
        exposure_time : float
            Seconds, for the dark current.
        rng : numpy.random.Generator
            Of this frame's noise.
        """
        expected = photoelectrons + np.float32(self.dark_current * exposure_time)
        electrons = np.minimum(_collected(expected, rng), np.float32(self.full_well))
        noise = rng.standard_normal(expected.shape, dtype=np.float32)
        counts = (electrons + np.float32(self.read_noise) * noise) / np.float32(self.conversion_gain)
        counts = np.rint(counts + np.float32(self.black_level))
        clipped: NDArray[np.uint16] = np.clip(counts, 0.0, self.saturation_level).astype(np.uint16)
        return clipped


def _collected(expected: Picture, rng: np.random.Generator) -> Picture:
    """Return electrons with shot noise, shape as `expected`."""
    noise = rng.standard_normal(expected.shape, dtype=np.float32)
    electrons = np.asarray(expected + np.sqrt(expected) * noise, dtype=np.float32)
    few = expected < _NORMAL_ABOVE
    electrons[few] = rng.poisson(expected[few])
    return electrons


def mosaic(picture: Picture) -> Picture:
    """Return the RGGB mosaic, shape (height, width), of an RGB picture, shape (height, width, 3)."""
    raw = picture[..., 1].copy()
    raw[0::2, 0::2] = picture[0::2, 0::2, 0]
    raw[1::2, 1::2] = picture[1::2, 1::2, 2]
    return raw
