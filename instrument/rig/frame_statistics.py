"""Statistics of a raw frame: clipping, darkness, focus, brightness, and a profile along a line."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.camera import CameraDescription

Counts = NDArray[np.uint16]

SHARP, BLACK, CLIPPED = 1, 2, 3
"""Values of `FrameFacts.marks`, in the order of their weight; 0 = nothing to say."""

N_BINS = 256

SHARP_NOISES = 6.0
"""Second differences beyond so many times their noise are edges in focus."""

_PIXELS_DIFFER = 0.01  # share by which pixels see the same light differently, at most


class Region(NamedTuple):
    """Rows and columns from, and up to but without."""

    top: int
    left: int
    bottom: int
    right: int

    def within(self, height: int, width: int) -> Region:
        """Return it cut to a picture, with even borders, so that it holds whole cells of a mosaic; never empty."""
        top, left = (min(max(n, 0), size - 2) // 2 * 2 for n, size in ((self.top, height), (self.left, width)))
        bottom, right = min(self.bottom, height) // 2 * 2, min(self.right, width) // 2 * 2
        return Region(top, left, max(bottom, top + 2), max(right, left + 2))


@dataclass(frozen=True)
class FrameFacts:
    """A frame, looked at.

    Attributes
    ----------
    marks : ndarray of uint8, shape (H, W)
        `CLIPPED`, `BLACK`, `SHARP` or 0, of the whole frame.
    histogram : dict of str to ndarray of int, shape (N_BINS,)
        Pixels by counts from 0 to 2^bit_depth, for each colour of the mosaic, or ``"grey"``.
    clipped, black : float
        Share of pixels at the saturation level, and not above the black level.
    focus : float
        Strength of the edges over the brightness: larger is sharper, whatever the exposure.
    median : float
        Counts.
    """

    marks: NDArray[np.uint8]
    histogram: dict[str, NDArray[np.int64]]
    clipped: float
    black: float
    focus: float
    median: float


def frame_facts(counts: Counts, camera: CameraDescription, region: Region | None = None) -> FrameFacts:
    """Look at a frame of raw counts.

    Parameters
    ----------
    counts : ndarray of uint16, shape (H, W)
        Right-aligned.
    camera : CameraDescription
        Says what is black, what clips, and which colours the mosaic has.
    region : Region, optional
        What the histogram and the numbers are of; by default the whole frame.
    """
    top, left, bottom, right = (region or Region(0, 0, *counts.shape)).within(*counts.shape)
    marks, edges = _marks(counts, camera)
    marks_there, counts_there = marks[top:bottom, left:right], counts[top:bottom, left:right]
    edges_there = edges[top // 2 : bottom // 2, left // 2 : right // 2]
    brightness = max(float(counts_there[::8, ::8].mean()) - camera.black_level, 1.0)
    histogram = _histogram(counts_there, camera)
    return FrameFacts(
        marks=marks,
        histogram=histogram,
        clipped=_share(marks_there, CLIPPED),
        black=_share(marks_there, BLACK),
        focus=float(cv2.meanStdDev(edges_there)[1][0, 0]) / brightness,
        median=_median(np.sum(list(histogram.values()), axis=0), camera.bit_depth),
    )


def profile(
    counts: Counts, bayer_pattern: str, start: tuple[float, float], end: tuple[float, float]
) -> dict[str, tuple[NDArray[np.float64], Counts]]:
    """Return the raw counts of the pixels along a line.

    Parameters
    ----------
    counts : ndarray of uint16, shape (H, W)
    bayer_pattern : str
        ``""`` for a monochrome frame.
    start, end : tuple of float
        Row and column; what is outside the frame is left out.

    Returns
    -------
    dict of str to tuple of ndarray
        For each colour, or ``"grey"``: the distance from `start` in pixels, and the counts there.
    """
    length = float(np.hypot(end[0] - start[0], end[1] - start[1]))
    along = np.arange(np.floor(length) + 1.0)
    places = np.array(start) + along[:, None] / max(length, 1.0) * (np.array(end) - np.array(start))
    pixels = np.floor(places).astype(int)
    inside = ((pixels >= 0) & (pixels < counts.shape)).all(axis=1)
    row, column = pixels[inside].T
    pattern = np.array(list(bayer_pattern or "...."))
    colour = pattern[2 * (row % 2) + column % 2]
    values, distance = counts[row, column], along[inside]
    names = {"grey": "."} if not bayer_pattern else {name: name for name in dict.fromkeys(bayer_pattern)}
    return {name: (distance[colour == key], values[colour == key]) for name, key in names.items()}


def _marks(counts: Counts, camera: CameraDescription) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Return the marks, and the strength of the edges, half the size."""
    cells = _cells(counts)
    edges = np.abs(cv2.Laplacian(cells, cv2.CV_32F))
    sharp = (edges > SHARP_NOISES * _edge_noise(cells, camera)).view(np.uint8) * np.uint8(SHARP)
    marks = np.zeros(counts.shape, np.uint8)
    height, width = (2 * n for n in sharp.shape)
    cv2.resize(sharp, (width, height), dst=marks[:height, :width], interpolation=cv2.INTER_NEAREST)
    # At the black level is black, at the saturation level is clipped; compared as integers, which is faster.
    np.copyto(marks, BLACK, where=counts <= np.uint16(camera.black_level))
    np.copyto(marks, CLIPPED, where=counts >= np.uint16(np.ceil(camera.saturation_level)))
    return marks, np.asarray(edges, np.float32)


def _cells(counts: Counts) -> Counts:
    """Return means of cells of 2 x 2 pixels, in which no mosaic is."""
    height, width = (n - n % 2 for n in counts.shape)
    means = cv2.resize(counts[:height, :width], (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    return np.asarray(means, np.uint16)


def _edge_noise(cells: Counts, camera: CameraDescription) -> NDArray[np.float32]:
    """Return the standard deviation of second differences of an even surface.

    With s the signal above black, g the electrons per count and r the read noise, a cell of four pixels has the
    variance v = ((r / g)^2 + s / g + (p s)^2 + 1 / 12) / 4 + 1 / 12, where p stands for what pixels differ by and the
    twelfths for rounding; its second differences, 4 c - (c_1 + c_2 + c_3 + c_4), have 20 v.
    """
    g, r, p = camera.conversion_gain, camera.read_noise, _PIXELS_DIFFER
    signal = cv2.subtract(cells, np.array([camera.black_level]), dtype=cv2.CV_32F)
    s = np.maximum(signal, 0.0, dtype=np.float32)
    constant = np.float32(20.0 * (((r / g) ** 2 + 1.0 / 12.0) / 4.0 + 1.0 / 12.0))
    return np.asarray(np.sqrt(constant + s * (np.float32(5.0 / g) + np.float32(5.0 * p**2) * s)), np.float32)


def _share(marks: NDArray[np.uint8], mark: int) -> float:
    return float(cv2.countNonZero(cv2.inRange(marks, mark, mark))) / marks.size


def _histogram(counts: Counts, camera: CameraDescription) -> dict[str, NDArray[np.int64]]:
    if not camera.bayer_pattern:
        return {"grey": _binned(counts, camera.bit_depth)}
    colours: dict[str, NDArray[np.int64]] = {}
    for i, name in enumerate(camera.bayer_pattern):
        binned = _binned(counts[i // 2 :: 2, i % 2 :: 2], camera.bit_depth)
        colours[name] = colours.get(name, np.zeros(N_BINS, np.int64)) + binned
    return colours


def _binned(counts: Counts, bit_depth: int) -> NDArray[np.int64]:
    top = float(2**bit_depth)
    return cv2.calcHist([np.ascontiguousarray(counts)], [0], None, [N_BINS], [0.0, top]).ravel().astype(np.int64)


def _median(histogram: NDArray[np.int64], bit_depth: int) -> float:
    """Return the count below which half of the pixels lie, to a bin."""
    half = np.searchsorted(np.cumsum(histogram), histogram.sum() / 2)
    return float((half + 0.5) * 2**bit_depth / N_BINS)
