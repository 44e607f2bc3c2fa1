"""What the operator has to see of a raw frame: where it clips, is black, is sharp, and how bright it is."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.camera import CameraDescription

CLIPPED, BLACK, SHARP = 1, 2, 3
"""Values of `LiveFacts.marks`; 0 = nothing to say."""

N_BINS = 256
SHARP_NOISES = 8.0
"""Second differences beyond so many times their median are edges in focus."""


@dataclass(frozen=True)
class LiveFacts:
    """A frame, looked at.

    Attributes
    ----------
    shown : ndarray of uint8, shape (H, W)
        From the black level to the saturation level.
    marks : ndarray of uint8, shape (H, W)
        `CLIPPED`, `BLACK`, `SHARP` or 0.
    histogram : dict of str to ndarray of int, shape (N_BINS,)
        Pixels by counts from 0 to 2^bit_depth, for each colour of the mosaic, or ``"grey"``.
    clipped, black : float
        Share of pixels at the saturation level, and not above the black level.
    focus : float
        Strength of the edges over the brightness: larger is sharper, whatever the exposure.
    median : float
        Counts.
    """

    shown: NDArray[np.uint8]
    marks: NDArray[np.uint8]
    histogram: dict[str, NDArray[np.int64]]
    clipped: float
    black: float
    focus: float
    median: float


def live_facts(counts: NDArray[np.uint16], camera: CameraDescription) -> LiveFacts:
    """Look at a frame of raw counts, shape (H, W), right-aligned.

    Parameters
    ----------
    counts : ndarray of uint16, shape (H, W)
    camera : CameraDescription
        Says what is black, what clips, and which colours the mosaic has.
    """
    span = camera.saturation_level - camera.black_level
    scaled = cv2.convertScaleAbs(counts, alpha=255.0 / span, beta=-255.0 * camera.black_level / span)
    shown = np.asarray(scaled, np.uint8)
    shown[counts < camera.black_level] = 0  # which the absolute value has turned round
    clipped, black = counts >= camera.saturation_level, counts <= camera.black_level
    edges = _edges(counts)
    brightness = max(float(counts[::8, ::8].mean()) - camera.black_level, 1.0)
    marks = np.zeros(counts.shape, np.uint8)
    sharp = edges > SHARP_NOISES * max(float(np.median(edges[::4, ::4])), 1.0)
    height, width = (2 * n for n in sharp.shape)
    marks[:height, :width] = np.where(np.repeat(np.repeat(sharp, 2, axis=0), 2, axis=1), SHARP, 0)
    marks[black], marks[clipped] = BLACK, CLIPPED
    histogram = _histogram(counts, camera)
    return LiveFacts(
        shown=shown,
        marks=marks,
        histogram=histogram,
        clipped=float(clipped.mean()),
        black=float(black.mean()),
        focus=float(edges.std()) / brightness,
        median=_median(np.sum(list(histogram.values()), axis=0), camera.bit_depth),
    )


def _edges(counts: NDArray[np.uint16]) -> NDArray[np.float32]:
    """Return the absolute second differences between cells of 2 x 2 pixels, in which no mosaic is, half the size."""
    height, width = (n - n % 2 for n in counts.shape)
    even = counts[:height, :width]
    cells = cv2.resize(even, (width // 2, height // 2), interpolation=cv2.INTER_AREA)
    return np.abs(cv2.Laplacian(cells, cv2.CV_32F))


def _histogram(counts: NDArray[np.uint16], camera: CameraDescription) -> dict[str, NDArray[np.int64]]:
    if not camera.bayer_pattern:
        return {"grey": _binned(counts, camera.bit_depth)}
    colours: dict[str, NDArray[np.int64]] = {}
    for i, name in enumerate(camera.bayer_pattern):
        binned = _binned(counts[i // 2 :: 2, i % 2 :: 2], camera.bit_depth)
        colours[name] = colours.get(name, np.zeros(N_BINS, np.int64)) + binned
    return colours


def _binned(counts: NDArray[np.uint16], bit_depth: int) -> NDArray[np.int64]:
    top = float(2**bit_depth)
    return cv2.calcHist([np.ascontiguousarray(counts)], [0], None, [N_BINS], [0.0, top]).ravel().astype(np.int64)


def _median(histogram: NDArray[np.int64], bit_depth: int) -> float:
    """Return the count below which half of the pixels lie, to a bin."""
    half = np.searchsorted(np.cumsum(histogram), histogram.sum() / 2)
    return float((half + 0.5) * 2**bit_depth / N_BINS)
