"""A picture as its file holds it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray


class UnreadablePictureError(ValueError):
    """A file is no picture, is damaged, or is of a kind that cannot be used."""


@dataclass(frozen=True, slots=True)
class Picture:
    """The pixels of a file, and what the file says of them.

    Attributes
    ----------
    pixels : ndarray of uint8, uint16 or float32, shape (H, W) or (H, W, 3)
        As stored; three channels are red, green, blue.
    bayer_pattern : str or None
        Colours of the 2 x 2 cell in reading order, ``""`` for none; None if the format does not say.
    black_level : tuple of float or None
        At the four places of the cell in reading order, in units of `pixels`.
    saturation_level : float or None
        In units of `pixels`.
    """

    pixels: NDArray[Any]
    bayer_pattern: str | None = None
    black_level: tuple[float, ...] | None = None
    saturation_level: float | None = None


Reader = Callable[[Path], Picture]


def checked(picture: Picture) -> Picture:
    """Return `picture` in one of the forms that `Picture` allows.

    Raises
    ------
    UnreadablePictureError
        If it has another number of channels, another type, or no pixels.
    """
    # Files may have either order of bytes.
    pixels = picture.pixels.astype(picture.pixels.dtype.newbyteorder("="), copy=False)
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[..., 0]
    if pixels.ndim not in (2, 3) or (pixels.ndim == 3 and pixels.shape[2] != 3) or 0 in pixels.shape:
        raise UnreadablePictureError(f"has shape {pixels.shape}; needed is (height, width), or 3 channels more")
    if pixels.dtype in (np.float16, np.float32, np.float64):
        pixels = _finite(pixels.astype(np.float32))
    if pixels.dtype not in (np.uint8, np.uint16, np.float32):
        raise UnreadablePictureError(f"has values of type {pixels.dtype}; needed are 8 or 16 bits, or floating point")
    return Picture(np.ascontiguousarray(pixels), picture.bayer_pattern, picture.black_level, picture.saturation_level)


def _finite(pixels: NDArray[np.float32]) -> NDArray[np.float32]:
    if not np.isfinite(pixels).all():
        raise UnreadablePictureError("has pixels that are NaN or infinite; write numbers only")
    return pixels
