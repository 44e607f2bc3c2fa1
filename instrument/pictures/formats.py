"""Reads TIFF, PNG, JPEG, EXR and NumPy files as they are: no scaling, no rotation, no colour management."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import tifffile
from numpy.typing import NDArray
from PIL import Image

from instrument.pictures.picture import Picture, UnreadablePictureError

# Pillow's own limit is that of a suspicious web page; a phone exceeds it.
Image.MAX_IMAGE_PIXELS = 1_000_000_000


def read_tiff(path: Path) -> Picture:
    """Read a TIFF file of one page."""
    with tifffile.TiffFile(path) as file:
        if len(file.pages) > 1:
            raise UnreadablePictureError(f"holds {len(file.pages)} pictures; save each in a file of its own")
        page = file.pages.first
        _refuse_other_meanings(page)
        try:
            pixels = page.asarray()
        except ValueError as error:
            if "imagecodecs" not in str(error):
                raise
            if page.photometric == tifffile.PHOTOMETRIC.MINISWHITE:
                # OpenCV turns some of these round itself and others not.
                raise UnreadablePictureError("has white as 0 and is compressed; save it uncompressed") from None
            pixels = _read_with_opencv(path)
        channels_first = pixels.ndim == 3 and page.planarconfig == tifffile.PLANARCONFIG.SEPARATE
        if page.photometric == tifffile.PHOTOMETRIC.MINISWHITE:
            # 0 is white there: the light grows as the values fall.
            pixels = np.iinfo(pixels.dtype).max - pixels
        return Picture(_without_alpha(np.moveaxis(pixels, 0, -1) if channels_first else pixels))


def read_png(path: Path) -> Picture:
    """Read a PNG file; OpenCV takes all depths, Pillow checks that every part is whole."""
    with Image.open(path) as file:
        file.verify()
    return Picture(_read_with_opencv(path), bayer_pattern=None)


def read_jpeg(path: Path) -> Picture:
    """Read a JPEG file; by Pillow, since OpenCV fills what is missing of a truncated one with grey."""
    with Image.open(path) as file:
        if file.mode not in ("L", "RGB"):
            raise UnreadablePictureError(f"has colours of the kind {file.mode}; save it as RGB or grey")
        file.load()
        return Picture(np.asarray(file), bayer_pattern="")


def read_exr(path: Path) -> Picture:
    """Read the first part of an EXR file: R, G, B or Y."""
    with OpenEXR.File(str(path)) as file:
        if not file.parts:
            raise UnreadablePictureError("is damaged or cut short")
        channels = file.channels()
        name = next((n for n in ("RGB", "RGBA", "Y") if n in channels), None)
        if name is None:
            raise UnreadablePictureError(f"has the channels {', '.join(sorted(channels))}; needed are R, G, B or Y")
        return Picture(_without_alpha(np.asarray(channels[name].pixels)), bayer_pattern="" if name != "Y" else None)


def read_npy(path: Path) -> Picture:
    """Read an array that NumPy saved."""
    return Picture(np.load(path, allow_pickle=False))


def _refuse_other_meanings(page: Any) -> None:
    """Raise `UnreadablePictureError` for values that are no light of grey or of red, green and blue."""
    kinds = tifffile.PHOTOMETRIC
    if page.photometric not in (kinds.MINISBLACK, kinds.MINISWHITE, kinds.RGB, kinds.CFA):
        name = getattr(page.photometric, "name", str(page.photometric))
        raise UnreadablePictureError(f"has colours of the kind {name}; save it as RGB or grey")
    if page.photometric == kinds.MINISWHITE and page.sampleformat != tifffile.SAMPLEFORMAT.UINT:
        raise UnreadablePictureError("has white as 0 and values that are no whole numbers; save it with black as 0")
    if page.bitspersample not in (8, 16, 32, 64):
        raise UnreadablePictureError(f"has {page.bitspersample} bits a value, packed; save it with 16 bits")


def _read_with_opencv(path: Path) -> NDArray[Any]:
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise UnreadablePictureError("is no picture, or damaged")
    # Blue, green, red, alpha in OpenCV.
    pixels = _without_alpha(pixels)
    return pixels[..., ::-1] if pixels.ndim == 3 and pixels.shape[2] == 3 else pixels


def _without_alpha(pixels: NDArray[Any]) -> NDArray[Any]:
    """Return the colours of a picture whose fourth channel hides nothing of them."""
    if pixels.ndim != 3 or pixels.shape[2] not in (2, 4):
        return pixels
    alpha = pixels[..., -1]
    opaque = np.iinfo(alpha.dtype).max if alpha.dtype.kind in "iu" else 1.0
    if not np.all(alpha == opaque):
        raise UnreadablePictureError("is transparent in places, so that its values are not the light alone; flatten it")
    return pixels[..., :-1]
