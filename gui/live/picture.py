"""The live picture of a raw frame: brightness between two levels, with what is marked in colours of its own."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from drivers.camera import CameraDescription
from gui.widgets.plots import OKABE_ITO
from instrument.rig.frame_statistics import BLACK, CLIPPED, SHARP, Counts, FrameFacts, Region, frame_facts

MARK_COLOURS = {CLIPPED: OKABE_ITO["vermillion"], BLACK: OKABE_ITO["blue"], SHARP: OKABE_ITO["yellow"]}

BRIGHTEST = 255 - len(MARK_COLOURS)
"""Values of the picture up to this one are brightness, those above it are marks."""


class Wanted(NamedTuple):
    """What the operator wants to see.

    Attributes
    ----------
    low, high : float
        Counts that are shown black and white.
    marks : frozenset of int
        Those to show.
    region : Region or None
        What histogram and numbers are of.
    step : int
        So many pixels in each direction become one of the picture: no screen shows more than it has.
    """

    low: float
    high: float
    marks: frozenset[int] = frozenset((CLIPPED,))
    region: Region | None = None
    step: int = 1


@dataclass(frozen=True)
class Look:
    """A frame, ready to be shown.

    Attributes
    ----------
    counts : ndarray of uint16, shape (H, W)
    image : ndarray of uint8, shape (H // step, W // step)
        Brightness up to `BRIGHTEST`, marks above it.
    facts : FrameFacts
    step : int
        As it was wanted.
    """

    counts: Counts
    image: NDArray[np.uint8]
    facts: FrameFacts
    step: int


def look_at(asked: tuple[Counts, CameraDescription, Wanted]) -> Look:
    """Look at a frame of raw counts; for a worker."""
    counts, camera, wanted = asked
    facts = frame_facts(counts, camera, wanted.region)
    image = _brightness(_means(counts, wanted.step), wanted.low, wanted.high)
    cv2.max(image, _largest(_coded(facts.marks, wanted.marks), wanted.step), dst=image)
    return Look(counts, image, facts, wanted.step)


def colour_table() -> NDArray[np.uint8]:
    """Return the colours of the values of `Look.image`, shape (256, 3)."""
    table = np.empty((256, 3), np.uint8)
    table[: BRIGHTEST + 1] = np.linspace(0, 255, BRIGHTEST + 1)[:, None]
    for mark, colour in MARK_COLOURS.items():
        table[BRIGHTEST + mark] = [int(colour[i : i + 2], 16) for i in (1, 3, 5)]
    return table


def _means(counts: Counts, step: int) -> Counts:
    """Return means of blocks, in which no mosaic makes patterns with the dots of the screen."""
    if step == 1:
        return counts
    height, width = (n // step for n in counts.shape)
    whole = counts[: height * step, : width * step]
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), np.uint16)


def _largest(coded: NDArray[np.uint8], step: int) -> NDArray[np.uint8]:
    """Return the largest of each block: a single pixel that clips is seen however small the picture is."""
    if step == 1:
        return coded
    height, width = (n // step for n in coded.shape)
    largest = cv2.dilate(coded, np.ones((step, step), np.uint8), anchor=(0, 0))
    return np.ascontiguousarray(largest[: height * step : step, : width * step : step], np.uint8)


def _brightness(counts: Counts, low: float, high: float) -> NDArray[np.uint8]:
    # Counts are cut at both ends before they are scaled: the conversion turns negative values round.
    scale = BRIGHTEST / max(high - low, 1.0)
    above = cv2.subtract(counts, np.array([low], np.float64), dtype=cv2.CV_16U)
    return np.minimum(cv2.convertScaleAbs(above, alpha=scale), np.uint8(BRIGHTEST)).astype(np.uint8, copy=False)


def _coded(marks: NDArray[np.uint8], wanted: Collection[int]) -> NDArray[np.uint8]:
    """Return the values of the picture for the marks that are wanted, 0 elsewhere."""
    table = np.zeros(256, np.uint8)
    table[list(wanted)] = [BRIGHTEST + mark for mark in wanted]
    return np.asarray(cv2.LUT(marks, table), np.uint8)
