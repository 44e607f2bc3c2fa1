"""A picture as its file holds it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
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
    orientation : int
        How it is to be turned when it is shown, by EXIF's numbers; 1 = not at all.
    curve : str
        What the file itself says of values that are not proportional to light; ``""`` if it says nothing.
    """

    pixels: NDArray[Any]
    bayer_pattern: str | None = None
    black_level: tuple[float, ...] | None = None
    saturation_level: float | None = None
    orientation: int = 1
    curve: str = ""


_MIRRORED = (2, 4, 5, 7)

_SMALLEST = float(np.finfo(np.float32).tiny / np.finfo(np.float32).eps)
"""Below, the dark of a picture would have fewer digits than single precision has."""

Reader = Callable[[Path], Picture]


def checked(picture: Picture) -> Picture:
    """Return `picture` in one of the forms that `Picture` allows.

    Raises
    ------
    UnreadablePictureError
        If it has another number of channels, another type, or no pixels; or if it is mirrored.
    """
    if picture.orientation in _MIRRORED:
        what = f"is stored mirrored (orientation {picture.orientation}); save it upright, with orientation 1"
        raise UnreadablePictureError(what)
    # Files may have either order of bytes.
    pixels = picture.pixels.astype(picture.pixels.dtype.newbyteorder("="), copy=False)
    if pixels.ndim == 3 and pixels.shape[2] == 1:
        pixels = pixels[..., 0]
    if pixels.ndim not in (2, 3) or (pixels.ndim == 3 and pixels.shape[2] != 3) or 0 in pixels.shape:
        raise UnreadablePictureError(f"has shape {pixels.shape}; needed is (height, width), or 3 channels more")
    if pixels.dtype in (np.float16, np.float32, np.float64):
        pixels = _single(pixels)
    if pixels.dtype not in (np.uint8, np.uint16, np.float32):
        raise UnreadablePictureError(f"has values of type {pixels.dtype}; needed are 8 or 16 bits, or floating point")
    return replace(picture, pixels=np.ascontiguousarray(pixels))


def without_alpha(pixels: NDArray[Any], opaque: float | None = None) -> NDArray[Any]:
    """Return the colours of a picture whose second or fourth channel hides nothing of them.

    Parameters
    ----------
    pixels : ndarray
    opaque : float, optional
        Value that hides nothing; the largest of whole numbers, or 1.

    Raises
    ------
    UnreadablePictureError
        If it hides something.
    """
    if pixels.ndim != 3 or pixels.shape[2] not in (2, 4):
        return pixels
    alpha = pixels[..., -1]
    if opaque is None:
        opaque = np.iinfo(alpha.dtype).max if alpha.dtype.kind in "iu" else 1.0
    if not np.all(alpha == opaque):
        raise UnreadablePictureError("is transparent in places, so that its values are not the light alone; flatten it")
    return pixels[..., :-1]


def _single(pixels: NDArray[Any]) -> NDArray[np.float32]:
    """Return floating-point numbers in single precision, in which sessions hold them."""
    if not np.isfinite(pixels).all():
        raise UnreadablePictureError("has pixels that are NaN or infinite; write numbers only")
    largest = float(np.abs(pixels).max())
    if pixels.dtype.itemsize > 4 and largest > 0 and not _SMALLEST < largest < float(np.finfo(np.float32).max):
        raise UnreadablePictureError(f"has values up to {largest:g}, out of single precision; use another unit")
    return pixels.astype(np.float32)
