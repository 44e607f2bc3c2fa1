"""Whether a camera's counts are proportional to light: a bracket on a plate that keeps still.

The light is steady, so that twice the exposure time is twice the light. Each exposure is compared with one in the dark;
the first is repeated at the end, which tells how much the light has drifted meanwhile.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.camera import CameraDescription
from drivers.errors import DeviceError
from instrument.rig.rig import Rig

Array = NDArray[np.float64]

ALLOWED = 0.005
"""Largest relative departure of the counts from a straight line."""

_STEPS = (1.0, 0.5, 0.25, 0.125, 1.0)  # of the longest exposure; the last tells the drift

_N_FRAMES = 4

_BRIGHT, _DIM, _NEARLY_CLIPPED = 0.8, 0.3, 0.9  # shares of the range of the counts

_TRIES, _FIRST_TIME, _SPARE = 8, 0.01, 5.0  # of finding the longest exposure; seconds; seconds of the light's lease


@dataclass(frozen=True, slots=True)
class Linearity:
    """How far counts are from proportional to the exposure time.

    Attributes
    ----------
    times : tuple of float
        Exposure times as read back, seconds, descending.
    departures : tuple of float
        Of counts per second from their mean, relative, one a time, after the light's drift.
    sigma : float
        Standard deviation of the worst departure from noise, relative.
    drift : float
        Of the light over the bracket, relative.
    """

    times: tuple[float, ...]
    departures: tuple[float, ...]
    sigma: float
    drift: float

    @property
    def worst(self) -> float:
        """Largest departure, relative."""
        return max(map(abs, self.departures))

    @property
    def is_linear(self) -> bool:
        """Whether the departures are within `ALLOWED` and what noise explains."""
        return self.worst <= ALLOWED + 3.0 * self.sigma

    @property
    def time_offset(self) -> float:
        """Seconds that would have to be added to each exposure time for the counts to be proportional to it."""
        t, rate = np.array(self.times), 1.0 + np.array(self.departures)
        slope, offset = np.polyfit(t, rate * t, 1)
        return float(offset / slope)


def measure_linearity(rig: Rig) -> Linearity:
    """Take a bracket of a plate that keeps still under the rig's own light.

    Parameters
    ----------
    rig : Rig
        Connected camera and light.

    Raises
    ------
    DeviceError
        If a device fails, or no exposure time lets the picture be bright without clipping.
    """
    camera = rig.camera.describe()
    longest, pixels = _longest(rig, camera)
    measured = [_rate(rig, longest * step, pixels) for step in _STEPS]
    times, rates, sigmas = (np.array(column) for column in zip(*measured, strict=True))
    drift = float(rates[-1] / rates[0] - 1.0)
    steady = rates[:-1] / (1.0 + drift * np.arange(len(rates) - 1) / (len(rates) - 1))
    departures = steady / steady.mean() - 1.0
    return Linearity(tuple(times[:-1].tolist()), tuple(departures.tolist()), float((sigmas / rates).max()), drift)


def _longest(rig: Rig, camera: CameraDescription) -> tuple[float, NDArray[np.bool_]]:
    """Return the longest exposure time of the bracket, and the pixels that are bright and do not clip at it."""
    well, limits = camera.saturation_level - camera.black_level, camera.exposure_time_limits
    time = min(max(_FIRST_TIME, limits.low), limits.high)
    for _ in range(_TRIES):
        share = (_lit(rig, time) - camera.black_level) / well
        bright = float(np.percentile(share, 99))
        usable = (share > _DIM) & (share < _NEARLY_CLIPPED)
        if 0.6 < bright < _NEARLY_CLIPPED and usable.mean() > 0.01:
            return rig.camera.set_exposure_time(time), usable
        wanted = time * float(np.clip(_BRIGHT / max(bright, 1e-3), 0.1, 10.0)) * (0.5 if bright >= 1.0 else 1.0)
        time = min(max(wanted, limits.low), limits.high)
    raise DeviceError(
        f"no exposure time between {limits.low:g} and {limits.high:g} s makes the plate bright without clipping. "
        "Look at the plate, the light's level and the lens cap"
    )


def _rate(rig: Rig, exposure_time: float, pixels: NDArray[np.bool_]) -> tuple[float, float, float]:
    """Return exposure time as read back, counts per second of the pixels' mean, and their standard deviation."""
    time = rig.camera.set_exposure_time(exposure_time)
    signals = []
    for _ in range(_N_FRAMES):
        lit = _lit(rig, time)
        signals.append(float((lit - rig.camera.trigger().counts)[pixels].mean()))
    return time, float(np.mean(signals)) / time, float(np.std(signals, ddof=1)) / np.sqrt(_N_FRAMES) / time


def _lit(rig: Rig, exposure_time: float) -> Array:
    rig.camera.set_exposure_time(exposure_time)
    rig.light.on(rig.config.light.level, exposure_time + _SPARE)
    try:
        return rig.camera.trigger().counts.astype(np.float64)
    finally:
        rig.light.off()
