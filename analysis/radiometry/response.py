"""Response curves: from the counts of a non-linear picture, such as a JPEG, to linear light."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.radiometry.hdr import Sensor
from instrument.files.validation import Problem, raise_if_any
from instrument.pictures.srgb import linear_from_srgb

Array = NDArray[np.float64]

N_LEVELS = 256
"""Of an 8-bit picture."""

COUNT_SIGMA = 1.0
"""Noise of a count of a non-linear picture, rounding and compression included."""

_MIN_LEVELS = 16

_TITLE = "The response curve cannot be used."


@dataclass(frozen=True, slots=True)
class Response:
    """What each count of a picture stands for.

    Attributes
    ----------
    curve : ndarray, shape (n_channels, n_levels), or (1, n_levels) for all channels alike
        Linear exposure, relative; of 256 levels one that was estimated is 0.2159 at count 128, as sRGB is.
    sigma : ndarray, same shape
        Relative standard deviation of `curve`; 0 for a curve that was given.
    lowest, highest : int
        Counts between which the curve is known; beyond, it is extrapolated and a pixel not to be believed.
    """

    curve: Array
    sigma: Array
    lowest: int
    highest: int

    def linearise(self, counts: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.float32]:
        """Return the linear exposure of counts, shape (..., n_channels).

        Raises
        ------
        ValueError
            If a count is beyond the curve, or the channels are not those of the curve.
        """
        n_levels = self.curve.shape[1]
        if counts.size and counts.max() >= n_levels:
            raise ValueError(f"counts go up to {counts.max()}; the response curve has {n_levels} levels.")
        if len(self.curve) not in (1, counts.shape[-1]):
            raise ValueError(f"counts of {counts.shape[-1]} channels do not fit a curve of {len(self.curve)}.")
        table = self.curve.astype(np.float32)
        if len(table) == 1:
            return np.asarray(table[0][counts])
        return np.stack([line[counts[..., k]] for k, line in enumerate(table)], axis=-1)

    def sensor(self) -> Sensor:
        """Return the sensor that makes linear exposures with such noise as a count has.

        Noise in counts grows with the slope of the curve, which grows a little less than the exposure's root does:
        nearly as shot noise would, above a floor that is the slope at the dark end.
        """
        curve, n_levels = self.curve, self.curve.shape[1]
        slope = np.gradient(curve, axis=1).mean(axis=0) * COUNT_SIGMA
        gain = float(curve[:, n_levels // 2].mean() / slope[n_levels // 2] ** 2)
        return Sensor(curve[:, self.highest], gain, float(slope[self.lowest]) * gain, step=0.0)


def table_response(table: Array) -> Response:
    """Return a curve that was given as a table.

    Parameters
    ----------
    table : ndarray, shape (n_levels,), (1, n_levels) or (3, n_levels)
        Linear exposure of each count, relative, rising.

    Raises
    ------
    InvalidInputError
        With everything that is wrong with it.
    """
    curve = np.atleast_2d(np.asarray(table, np.float64))
    problems = []
    if curve.ndim != 2 or len(curve) not in (1, 3) or curve.shape[1] < _MIN_LEVELS:
        what = f"has the shape {curve.shape}; allowed are 1 or 3 rows of {_MIN_LEVELS} levels at least"
        raise_if_any(_TITLE, [Problem("response", what)])
    if not np.isfinite(curve).all() or curve.min(initial=0.0) < 0.0:
        problems.append(Problem("response", "has negative or missing values; exposure is 0 or more"))
    falling = np.flatnonzero((np.diff(curve, axis=-1) < 0.0).any(axis=0))
    if len(falling):
        problems.append(Problem("response", f"falls from count {falling[0]} to {falling[0] + 1}; it must rise"))
    raise_if_any(_TITLE, problems)
    return Response(curve, np.zeros_like(curve), 1, curve.shape[1] - 2)


def srgb(z: NDArray[np.int64] | Array) -> Array:
    """Return the linear value of sRGB's counts."""
    return linear_from_srgb(np.asarray(z, np.float64) / (N_LEVELS - 1))
