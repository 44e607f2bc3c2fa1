"""Reads TIFF files as they are: no scaling, no rotation, no colour management."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from instrument.pictures.formats import read_with_opencv
from instrument.pictures.picture import Picture, UnreadablePictureError, without_alpha
from instrument.pictures.raw_file import RAW_KINDS, read_dng
from instrument.pictures.stated_curve import curve_of_profile, is_ramp

_KINDS = tifffile.PHOTOMETRIC
_TRANSFER_FUNCTION, _PROFILE, _DNG_VERSION = 301, 34675, 50706
_SRGB = 1  # of EXIF's ColorSpace
_PACKED = range(9, 16)
"""Bits of values that stand side by side, and that this module unpacks."""


def read_tiff(path: Path) -> Picture:
    """Read a TIFF file of one page; one that is a DNG in all but its name as such."""
    with tifffile.TiffFile(path) as file:
        page: Any = file.pages.first
        if page.photometric in RAW_KINDS or _DNG_VERSION in page.tags:
            return read_dng(path)
        # Large stacks have one page, and all pictures behind it.
        if (n := max(len(file.pages), file.series[0].size // max(page.size, 1))) > 1:
            raise UnreadablePictureError(f"holds {n} pictures; save each in a file of its own")
        if (file.imagej_metadata or {}).get("c1") is not None:
            raise UnreadablePictureError("states a calibration of its values (ImageJ); save it without")
        _refuse_other_meanings(page)
        packed = page.bitspersample in _PACKED
        pixels = _unpacked(page) if packed else _pixels(page, path)
        if page.photometric == _KINDS.MINISWHITE:
            # 0 is white there: the light grows as the values fall.
            pixels = pixels.dtype.type(2**page.bitspersample - 1) - pixels
        return Picture(
            _without_alpha(pixels, page.bitspersample),
            saturation_level=2.0**page.bitspersample - 1 if packed else None,
            orientation=int(page.tags.valueof("Orientation", default=1)),
            curve=_stated_curve(page),
        )


def _refuse_other_meanings(page: Any) -> None:
    """Raise `UnreadablePictureError` for values that are no light of grey or of red, green and blue."""
    if page.photometric not in (_KINDS.MINISBLACK, _KINDS.MINISWHITE, _KINDS.RGB):
        name = getattr(page.photometric, "name", str(page.photometric))
        raise UnreadablePictureError(f"has colours of the kind {name}; save it as RGB or grey")
    if page.photometric == _KINDS.MINISWHITE and page.sampleformat != tifffile.SAMPLEFORMAT.UINT:
        raise UnreadablePictureError("has white as 0 and values that are no whole numbers; save it with black as 0")
    if page.bitspersample not in (8, 16, 32, 64, *_PACKED):
        raise UnreadablePictureError(f"has {page.bitspersample} bits a value; save it with 16 bits")
    if page.subfiletype & 1:
        raise UnreadablePictureError("begins with a reduced copy of its picture; save the picture alone")


def _pixels(page: Any, path: Path) -> NDArray[Any]:
    try:
        pixels: NDArray[Any] = page.asarray()
    except ValueError as error:
        if "imagecodecs" not in str(error):
            raise
        return _read_compressed(page, path)
    is_in_planes = pixels.ndim == 3 and page.planarconfig == tifffile.PLANARCONFIG.SEPARATE
    return np.moveaxis(pixels, 0, -1) if is_in_planes else pixels


def _read_compressed(page: Any, path: Path) -> NDArray[Any]:
    if page.photometric == _KINDS.MINISWHITE:
        # OpenCV turns some of these round itself and others not.
        raise UnreadablePictureError("has white as 0 and is compressed; save it uncompressed")
    if page.tags.valueof("Orientation", default=1) != 1:
        # The same for pictures that are to be turned.
        raise UnreadablePictureError("is compressed and to be turned when it is shown; save it uncompressed")
    is_in_planes = page.samplesperpixel > 1 and page.planarconfig == tifffile.PLANARCONFIG.SEPARATE
    if is_in_planes or page.samplesperpixel == 2 or page.dtype not in (np.uint8, np.uint16, np.float32, np.float64):
        # Of planes of floating-point numbers OpenCV hands on memory that it has not filled; of two values it drops one.
        raise UnreadablePictureError("is compressed in a way that cannot be read; save it uncompressed")
    pixels = read_with_opencv(path)
    if pixels.dtype != page.dtype or pixels.shape[:2] != (page.imagelength, page.imagewidth):
        raise UnreadablePictureError("is compressed in a way that cannot be read; save it uncompressed")
    return pixels


def _unpacked(page: Any) -> NDArray[np.uint16]:
    """Return values of 9 to 15 bits that stand side by side, each row from a byte of its own."""
    bits, planes = page.bitspersample, page.planarconfig == tifffile.PLANARCONFIG.SEPARATE
    is_plain = page.compression == 1 and page.predictor == 1 and page.fillorder == 1 and not page.is_tiled
    if not is_plain or page.sampleformat != tifffile.SAMPLEFORMAT.UINT:
        raise UnreadablePictureError(f"has {bits} bits a value, packed and compressed; save it with 16 bits")
    n_rows = page.imagelength * (page.samplesperpixel if planes else 1)
    n_values = page.imagewidth * (1 if planes else page.samplesperpixel)
    stride = (n_values * bits + 7) // 8
    stored = np.frombuffer(b"".join(_segments(page)), np.uint8)
    if stored.size != n_rows * stride:
        raise UnreadablePictureError("is damaged or cut short")
    each = np.unpackbits(stored.reshape(n_rows, stride), axis=1)[:, : n_values * bits].reshape(n_rows, n_values, bits)
    values = np.zeros((n_rows, n_values), np.uint16)
    for i in range(bits):
        values = values << 1 | each[..., i]
    if planes:
        return np.moveaxis(values.reshape(page.samplesperpixel, page.imagelength, page.imagewidth), 0, -1)
    return values.reshape(page.imagelength, page.imagewidth, page.samplesperpixel)


def _segments(page: Any) -> list[bytes]:
    file = page.parent.filehandle
    parts = []
    for offset, count in zip(page.dataoffsets, page.databytecounts, strict=True):
        file.seek(offset)
        parts.append(file.read(count))
    return parts


def _without_alpha(pixels: NDArray[Any], bits: int) -> NDArray[Any]:
    return without_alpha(pixels, 2**bits - 1 if pixels.dtype.kind == "u" else 1.0)


def _stated_curve(page: Any) -> str:
    tags = page.tags
    if (profile := tags.valueof(_PROFILE)) is not None:
        return curve_of_profile(bytes(profile))
    if (table := tags.valueof(_TRANSFER_FUNCTION)) is not None:
        size = 1 << page.bitspersample
        values = np.asarray(table, np.float64)
        return "" if values.size % size == 0 and all(map(is_ramp, values.reshape(-1, size))) else "a transfer function"
    exif = tags.valueof("ExifTag") or {}
    return "the curve of sRGB" if isinstance(exif, dict) and exif.get("ColorSpace") == _SRGB else ""
