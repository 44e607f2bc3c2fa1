"""Finds the count at which a sensor clips from the pile-up at the top of the histogram.

What clips piles up within fewer counts than shot noise would spread an even light over, and next to nothing
lies above it. Amplifiers, pixels' full wells and a white balance make the pile-up a few counts wide and its
place different for each place of the colour cell, so that each is looked at on its own.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.radiometry.hdr import Sensor
from analysis.radiometry.mosaic import cell_shape

Array = NDArray[np.float64]

Histogram = NDArray[np.int64]

PILE_UP_SHARE = 1e-5
"""Share of the pixels that must stand in the pile-up before it is believed, and at least `_MIN_PIXELS` of them."""

_MIN_PIXELS = 20

_CONTRAST = 10.0  # pixels in the pile-up over pixels in as many counts below it; an even light reaches 4

_ABOVE = 0.05  # pixels above the pile-up over those in it: hot pixels

_WIDEST = 2.0  # sigmas of shot noise


@dataclass(frozen=True, slots=True)
class Saturation:
    """Where each place of the cell clips.

    Attributes
    ----------
    level : ndarray, shape (2, 2) of a mosaic or (3,) of channels
        Counts: the lower edge of the pile-up, or the nominal level where there is none.
    nominal : float
        What the camera states.
    found : ndarray of bool, same shape
        Whether there is a pile-up.
    share : ndarray, same shape
        Of the pixels looked at, those at or above `level`.
    """

    level: Array
    nominal: float
    found: NDArray[np.bool_]
    share: Array


def find_saturation(frames: Iterable[NDArray[np.uint16]], nominal: float, black: float, sensor: Sensor) -> Saturation:
    """Find where a sensor clips.

    Parameters
    ----------
    frames : iterable of ndarray of uint16, shape (height, width) or (height, width, 3)
        All exposures of one pose or several, one after the other.
    nominal : float
        Clipping level that the camera states; a pile-up above it does not raise it.
    black : float
        Counts of darkness.
    sensor : Sensor
        For its noise.

    Raises
    ------
    ValueError
        If there is no frame.
    """
    shape: tuple[int, ...] = ()
    histograms: Histogram | None = None
    for frame in frames:
        shape = cell_shape(frame[None])
        counted = np.stack([np.bincount(place.ravel(), minlength=1 << 16) for place in _places(frame)])
        histograms = counted if histograms is None else histograms + counted
    if histograms is None:
        raise ValueError("there is no frame; a saturation level is found from one at least.")
    levels = [_pile_up(h, nominal, black, sensor) for h in histograms]
    level = np.array([nominal if at is None else min(at, nominal) for at in levels])
    share = [h[int(np.ceil(at)) :].sum() / h.sum() for h, at in zip(histograms, level, strict=True)]
    found = np.array([at is not None for at in levels])
    return Saturation(level.reshape(shape), nominal, found.reshape(shape), np.reshape(share, shape))


def _places(frame: NDArray[np.uint16]) -> list[NDArray[np.uint16]]:
    """Return the pixels of each place of the cell, or of each channel."""
    if frame.ndim == 3:
        return [frame[..., channel] for channel in range(frame.shape[2])]
    return [frame[row::2, column::2] for row in (0, 1) for column in (0, 1)]


def _pile_up(histogram: Histogram, nominal: float, black: float, sensor: Sensor) -> float | None:
    """Return the lower edge of the pile-up, None where there is none; the narrowest that passes is taken."""
    used = np.flatnonzero(histogram)
    if len(used) < 2:
        return None
    # A left-aligned converter leaves gaps.
    step = int(np.gcd.reduce(np.diff(used)))
    dense, first = histogram[used[0] :: step].astype(np.float64), int(used[0])
    spread = np.sqrt(max(nominal - black, 1.0) / sensor.conversion_gain + sensor.read_variance)
    widest = max(int(_WIDEST * spread / step), 1)
    width = 1
    while width <= widest:
        top = _window_of_pile_up(dense, width)
        if top is not None:
            edge = first + step * _lower_edge(dense, top - width + 1, width, 2 * widest)
            return float(edge) if edge - black > 0.5 * (nominal - black) else None
        width = max(width + 1, int(1.25 * width))
    return None


def _window_of_pile_up(histogram: Array, width: int) -> int | None:
    """Return the highest bin of a window of `width` that holds a pile-up, the fullest of those that do."""
    total = np.concatenate([[0.0], np.cumsum(histogram)])
    k = np.arange(len(histogram))
    low, far = np.maximum(k + 1 - width, 0), np.maximum(k + 1 - 5 * width, 0)
    inside, above = total[k + 1] - total[low], total[-1] - total[k + 1]
    beside = (total[low] - total[far]) / 4.0
    enough = max(PILE_UP_SHARE * total[-1], _MIN_PIXELS)
    passes = (inside >= enough) & (above <= _ABOVE * inside) & (inside > _CONTRAST * (beside + 1.0))
    return int(np.argmax(np.where(passes, inside, 0.0))) if passes.any() else None


def _lower_edge(histogram: Array, edge: int, width: int, far: int) -> int:
    """Move down from `edge` to where the histogram is as low as it is `far` below, twice what it is there at most."""
    background = histogram[max(edge - 2 * far, 0) : max(edge - far, 1)].mean() * width
    usual = 2.0 * background + 4.0 * np.sqrt(background) + 1.0
    while edge > width and histogram[edge - width : edge].sum() > usual:
        edge -= width
    return edge
