"""HDR merge of a bracket before demosaicing: raw counts to linear radiance with variance.

For a linear sensor with conversion gain g (e-/DN) and read noise r (e-), an exposure of time t_e gives
x_e = counts - dark with variance (x_e / g + (r / g)^2) DN^2. The estimate of the radiance L in DN/s is

    L = sum_e w_e x_e / t_e / sum_e w_e ,   w_e = t_e^2 / (L t_e / g + (r / g)^2)

over the exposures that did not clip. Where shot noise dominates it becomes sum x / sum t, the
Poisson-optimal estimate. The weights come from a first estimate of L, not from each x_e, since
weights that depend on the very noise they weigh bias the mean.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numba import prange
from numpy.typing import NDArray

from analysis.compiling import njit
from analysis.radiometry.mosaic import cell_shape

Array = NDArray[np.float64]

Array32 = NDArray[np.float32]

Counts = NDArray[np.uint16] | NDArray[np.float32]

CLIP_MARGIN = 0.01
"""Share of the range below the clipping level that is not trusted: the response bends before it clips."""

_MIN_VARIANCE = 1e-20  # keeps weights finite for floating-point pictures without any read noise


@dataclass(frozen=True, slots=True)
class Sensor:
    """What the merge needs to know of a sensor.

    Attributes
    ----------
    saturation_level : float or ndarray
        Counts at which it clips; or of each place of the mosaic's cell, shape (2, 2), or of each channel, shape (3,).
    conversion_gain : float
        Electrons per count.
    read_noise : float
        Electrons.
    step : float
        From one count to the next: 1 for right-aligned counts, 0 for floating-point pictures.
    """

    saturation_level: float | Array
    conversion_gain: float
    read_noise: float
    step: float = 1.0

    @property
    def read_variance(self) -> float:
        """Variance of a dark pixel with that of rounding, counts squared."""
        return float((self.read_noise / self.conversion_gain) ** 2 + self.step**2 / 12.0)


@dataclass(frozen=True, slots=True)
class Radiance:
    """A merged frame, still in the sensor's mosaic.

    Attributes
    ----------
    mean, variance : ndarray of float32, shape (height, width) or (height, width, 3)
        DN/s and its square.
    saturated : ndarray of bool, same shape
        Clipped even in the shortest exposure; `mean` is a lower bound there.
    valid : ndarray of uint8, same shape
        How many exposures did not clip.
    """

    mean: Array32
    variance: Array32
    saturated: NDArray[np.bool_]
    valid: NDArray[np.uint8]


def merge_bracket(counts: Counts, exposure_times: Array, dark: Array32 | Array, sensor: Sensor) -> Radiance:
    """Merge the frames of one pose.

    Parameters
    ----------
    counts : ndarray of uint16 or float32, shape (n_exposures, height, width) or (n_exposures, height, width, 3)
    exposure_times : ndarray, shape (n_exposures,)
        Seconds, as the camera reported them.
    dark : ndarray
        Mean counts with the light off: shape of `counts`, per exposure time; or of each place of the mosaic's
        cell, shape (2, 2); or of each channel, shape (3,).
    sensor : Sensor

    Returns
    -------
    Radiance

    Raises
    ------
    ValueError
        If the shapes do not agree or an exposure time is not positive.
    """
    if exposure_times.shape != counts.shape[:1] or (dark.shape != counts.shape and dark.shape != cell_shape(counts)):
        raise ValueError(
            f"counts {counts.shape}, dark {dark.shape} and exposure_times {exposure_times.shape} do not agree; "
            "the first two must be (exposures, height, width), the last (exposures,); dark may be the level of each "
            f"place of the cell, {cell_shape(counts)}."
        )
    if not np.all(exposure_times > 0.0):
        raise ValueError(f"exposure_times are {exposure_times} s; each must be positive.")
    limit = np.broadcast_to(trusted_level(dark, sensor), cell_shape(counts))
    rows: Any = np.ascontiguousarray(counts).reshape(*counts.shape[:2], -1)
    mean, variance, saturated, valid = _merge(
        rows,
        exposure_times.astype(np.float32),
        _dark_rows(dark, counts),
        _cell_rows(limit, rows.shape[2]),
        np.float32(1.0 / sensor.conversion_gain),
        np.float32(max(sensor.read_variance, _MIN_VARIANCE)),
    )
    shape = counts.shape[1:]
    return Radiance(mean.reshape(shape), variance.reshape(shape), saturated.reshape(shape), valid.reshape(shape))


def trusted_level(dark: NDArray[Any], sensor: Sensor) -> Array:
    """Return the counts up to which a pixel is believed: a little below where it clips."""
    saturation = np.asarray(sensor.saturation_level, np.float64)
    # A sample of the darks will do: the margin need not be known to the count.
    black = float(np.median(dark.reshape(-1)[:: max(dark.size // 100_000, 1)]))
    return np.asarray(saturation - CLIP_MARGIN * (saturation - black) if np.isfinite(saturation).all() else saturation)


def _dark_rows(dark: NDArray[Any], counts: NDArray[Any]) -> Array32:
    """Return darks as rows, shape (n_exposures or 1, height or rows of the cell, width times channels)."""
    if dark.shape == counts.shape:
        return np.ascontiguousarray(dark, np.float32).reshape(*counts.shape[:2], -1)
    return _cell_rows(dark, int(np.prod(counts.shape[2:])))[None]


def _cell_rows(cell: NDArray[Any], length: int) -> Array32:
    """Repeat the rows of a cell to `length`."""
    rows = np.atleast_2d(cell).astype(np.float32)
    return np.ascontiguousarray(np.tile(rows, (1, length // rows.shape[1] + 1))[:, :length])


@njit(cache=True, nogil=True, parallel=True, fastmath={"contract", "nsz"}, error_model="numpy")
def _merge(
    counts: Counts,
    exposure_times: Array32,
    dark: Array32,
    trusted: Array32,
    inverse_gain: np.float32,
    read_variance: np.float32,
) -> tuple[Array32, Array32, NDArray[np.bool_], NDArray[np.uint8]]:
    """Merge row by row: each step is a loop over a row, which becomes vector instructions."""
    n_exposures, height, width = counts.shape
    mean, variance = np.empty((height, width), np.float32), np.empty((height, width), np.float32)
    saturated, valid = np.zeros((height, width), np.bool_), np.zeros((height, width), np.uint8)
    shortest = np.argmin(exposure_times)
    for i in prange(height):
        limit = trusted[i % trusted.shape[0]]
        total, weight, L = np.zeros(width, np.float32), np.zeros(width, np.float32), np.empty(width, np.float32)
        for e in range(n_exposures):
            black = dark[e % dark.shape[0], i % dark.shape[1]]
            _add_counts(counts[e, i], black, limit, exposure_times[e], total, weight, valid[i])
        for j in range(width):
            L[j] = max(total[j] / weight[j], np.float32(0.0)) * inverse_gain
        total[:], weight[:] = np.float32(0.0), np.float32(0.0)
        for e in range(n_exposures):
            black = dark[e % dark.shape[0], i % dark.shape[1]]
            t = exposure_times[e]
            _add_weighted(counts[e, i], black, limit, t, L, read_variance / t, total, weight)
        for j in range(width):
            mean[i, j], variance[i, j] = total[j] / weight[j], np.float32(1.0) / weight[j]
        black = dark[shortest % dark.shape[0], i % dark.shape[1]]
        t = exposure_times[shortest]
        for j in range(width):
            if valid[i, j] == 0:
                # What is not a number has not clipped either.
                saturated[i, j] = counts[shortest, i, j] >= limit[j]
                mean[i, j] = (limit[j] - black[j]) / t if saturated[i, j] else np.float32(np.nan)
                variance[i, j] = (mean[i, j] * t * inverse_gain + read_variance) / (t * t)
    return mean, variance, saturated, valid


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"})
def _add_counts(
    counts: Counts, black: Array32, limit: Array32, t: np.float32, total: Array32, time: Array32,
    valid: NDArray[np.uint8],
) -> None:  # fmt: skip
    for j in range(len(total)):
        x = np.float32(counts[j])
        good = x < limit[j]
        total[j] += x - black[j] if good else np.float32(0.0)
        time[j] += t if good else np.float32(0.0)
        valid[j] += good


@njit(cache=True, nogil=True, fastmath={"contract", "nsz"}, error_model="numpy")
def _add_weighted(
    counts: Counts, black: Array32, limit: Array32, t: np.float32, L: Array32, variance: np.float32,
    total: Array32, weight: Array32,
) -> None:  # fmt: skip
    """Add x w / t and w, where w = t / (L / g + variance / t)."""
    for j in range(len(total)):
        x = np.float32(counts[j])
        w = np.float32(1.0) / (L[j] + variance) if x < limit[j] else np.float32(0.0)
        total[j] += w * (x - black[j]) if x < limit[j] else np.float32(0.0)
        weight[j] += w * t
