"""HDR merge of a bracket in the Bayer domain: raw counts to linear radiance with variance.

For a linear sensor with conversion gain g (e-/DN) and read noise r (e-), an exposure of time t_e gives
x_e = counts - dark with variance (x_e / g + (r / g)^2) DN^2. The estimate of the radiance L in DN/s is

    L = sum_e w_e x_e / t_e / sum_e w_e ,   w_e = t_e^2 / (L t_e / g + (r / g)^2)

over the exposures that did not clip. Where shot noise dominates it becomes sum x / sum t, the
Poisson-optimal estimate. The weights come from a first estimate of L, not from each x_e, since
weights that depend on the very noise they weigh bias the mean.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit, prange
from numpy.typing import NDArray

CLIP_MARGIN = 0.01
"""Share of the range below the clipping level that is not trusted: the response bends before it clips."""

PILE_UP_SHARE = 1e-5
"""Share of a frame's pixels that must stand at one highest count before that count is the clipping level."""


@dataclass(frozen=True, slots=True)
class Sensor:
    """What the merge needs to know of a sensor.

    Attributes
    ----------
    saturation_level : float
        Counts at which it clips.
    conversion_gain : float
        Electrons per count.
    read_noise : float
        Electrons.
    """

    saturation_level: float
    conversion_gain: float
    read_noise: float


@dataclass(frozen=True, slots=True)
class Radiance:
    """A merged frame, still in the sensor's mosaic.

    Attributes
    ----------
    mean, variance : ndarray of float32, shape (height, width)
        DN/s and its square.
    saturated : ndarray of bool, shape (height, width)
        Clipped even in the shortest exposure; `mean` is a lower bound there.
    """

    mean: NDArray[np.float32]
    variance: NDArray[np.float32]
    saturated: NDArray[np.bool_]


def merge_bracket(
    counts: NDArray[np.uint16],
    exposure_times: NDArray[np.float64],
    dark: NDArray[np.float32],
    sensor: Sensor,
) -> Radiance:
    """Merge the frames of one pose.

    Parameters
    ----------
    counts : ndarray of uint16, shape (n_exposures, height, width)
    exposure_times : ndarray, shape (n_exposures,)
        Seconds, as the camera reported them.
    dark : ndarray of float32, shape (n_exposures, height, width)
        Mean counts with the light off, per exposure time.
    sensor : Sensor

    Returns
    -------
    Radiance

    Raises
    ------
    ValueError
        If the shapes do not agree or an exposure time is not positive.
    """
    if counts.shape != dark.shape or exposure_times.shape != counts.shape[:1]:
        raise ValueError(
            f"counts {counts.shape}, dark {dark.shape} and exposure_times {exposure_times.shape} do not agree; "
            "the first two must be (exposures, height, width), the last (exposures,)."
        )
    if not np.all(exposure_times > 0.0):
        raise ValueError(f"exposure_times are {exposure_times} s; each must be positive.")
    trusted = sensor.saturation_level - CLIP_MARGIN * (sensor.saturation_level - float(np.median(dark)))
    mean, variance, saturated = _merge(
        counts,
        exposure_times.astype(np.float32),
        dark.astype(np.float32, copy=False),
        np.float32(trusted),
        np.float32(1.0 / sensor.conversion_gain),
        np.float32((sensor.read_noise / sensor.conversion_gain) ** 2),
    )
    return Radiance(mean, variance, saturated)


@njit(cache=True, nogil=True, parallel=True, fastmath=True)
def _merge(
    counts: NDArray[np.uint16],
    exposure_times: NDArray[np.float32],
    dark: NDArray[np.float32],
    trusted: np.float32,
    inverse_gain: np.float32,
    read_variance: np.float32,
) -> tuple[NDArray[np.float32], NDArray[np.float32], NDArray[np.bool_]]:
    n_exposures, height, width = counts.shape
    mean = np.empty((height, width), np.float32)
    variance = np.empty((height, width), np.float32)
    saturated = np.zeros((height, width), np.bool_)
    shortest = np.argmin(exposure_times)
    for i in prange(height):
        for j in range(width):
            total, time = np.float32(0.0), np.float32(0.0)
            for e in range(n_exposures):
                if counts[e, i, j] < trusted:
                    total += counts[e, i, j] - dark[e, i, j]
                    time += exposure_times[e]
            if time == 0.0:
                t = exposure_times[shortest]
                mean[i, j] = (trusted - dark[shortest, i, j]) / t
                variance[i, j] = (mean[i, j] * t * inverse_gain + read_variance) / (t * t)
                saturated[i, j] = True
                continue
            L = max(total / time, np.float32(0.0))
            total, weight = np.float32(0.0), np.float32(0.0)
            for e in range(n_exposures):
                if counts[e, i, j] < trusted:
                    t = exposure_times[e]
                    # One count of quantisation keeps the variance positive without read noise.
                    w = t / (L * inverse_gain + (read_variance + np.float32(1.0 / 12.0)) / t)
                    total += w * (counts[e, i, j] - dark[e, i, j]) / t
                    weight += w
            mean[i, j] = total / weight
            variance[i, j] = np.float32(1.0) / weight
    return mean, variance, saturated


def clipping_level(frame: NDArray[np.uint16], nominal: float) -> float:
    """Return the count at which a frame clips: its pile-up where it has one, else the nominal level.

    Metadata can be off; pixels that clip below the stated level would enter as values. Only a pile-up
    at the top of the histogram counts, and never above `nominal`.

    Parameters
    ----------
    frame : ndarray of uint16, shape (height, width)
        The longest exposure at hand.
    nominal : float
        What the camera states.
    """
    top = int(frame.max())
    pile = int(np.count_nonzero(frame == top))
    beside = int(np.count_nonzero(frame == max(top - 1, 0)))
    piled = pile > max(PILE_UP_SHARE * frame.size, 10 * (beside + 1)) and top > 0.5 * nominal
    return min(float(top), nominal) if piled else nominal
