"""Reads RAW files of cameras with LibRaw: the sensor's own counts, before anything is done to them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import rawpy
import tifffile

from instrument.pictures.picture import Picture, UnreadablePictureError

_RAW_KINDS = (tifffile.PHOTOMETRIC.CFA, tifffile.PHOTOMETRIC.LINEAR_RAW)
_BLACK_REPEAT, _BLACK_LEVEL = 50713, 50714


def read_raw(path: Path) -> Picture:
    """Read the visible part of a RAW file; masked borders of the sensor are left out."""
    if path.suffix.lower() == ".dng":
        refuse_altered(path)
    with rawpy.imread(str(path)) as raw:
        pixels = raw.raw_image_visible.copy()
        if raw.raw_type == rawpy.RawType.Stack:
            # A fourth channel is there for sensors of four colours only.
            return Picture(pixels[..., :3], "", _plain(raw.black_level_per_channel), _white(raw))
        if raw.raw_pattern is None or raw.num_colors == 1:
            return Picture(pixels, "", _plain(raw.black_level_per_channel), _white(raw))
        _check_mosaic(raw.raw_pattern.shape)
        cell = [int(colour) for colour in raw.raw_colors_visible[:2, :2].ravel()]
        black = tuple(float(raw.black_level_per_channel[colour]) for colour in cell)
        return Picture(pixels, _pattern(raw, cell), black, _white(raw))


def refuse_altered(path: Path) -> None:
    """Raise `UnreadablePictureError` for a DNG whose values or black levels LibRaw does not hand on as they are.

    LibRaw scales floating-point values to each file's own maximum, so that frames of one bracket no longer compare;
    and it hands on one black level for all channels of a linear DNG, and none of patterns larger than the cell.
    """
    with tifffile.TiffFile(path) as file:
        pages = [page for first in file.pages for page in (first, *(first.pages or ()))]
        for tags in (page.tags for page in pages if page.tags.valueof("PhotometricInterpretation") in _RAW_KINDS):
            _refuse_meanings(tags)


def _refuse_meanings(tags: tifffile.TiffTags) -> None:
    formats = np.ravel(tags.valueof("SampleFormat", default=1))
    if np.any(formats == tifffile.SAMPLEFORMAT.IEEEFP):
        raise UnreadablePictureError(
            "holds floating-point values, each file scaled to its own maximum when it is read; save it as EXR or TIFF"
        )
    rows, columns = np.ravel(tags.valueof(_BLACK_REPEAT, default=(1, 1)))[:2]
    if (rows, columns) not in {(1, 1), (2, 2)}:
        raise UnreadablePictureError(f"has black levels in a pattern of {rows} x {columns}; usable are 1 and 2 x 2")
    is_linear = tags.valueof("PhotometricInterpretation") == tifffile.PHOTOMETRIC.LINEAR_RAW
    black = np.ravel(tags.valueof(_BLACK_LEVEL, default=0)).astype(float)
    if black.size == 2 * max(np.ravel(tags.valueof("SamplesPerPixel", default=1))[0], 1) and black.size > 1:
        black = black[::2] / black[1::2]  # rational numbers, numerator and denominator
    if is_linear and np.unique(black).size > 1:
        levels = ", ".join(f"{level:g}" for level in black)
        raise UnreadablePictureError(f"has black levels {levels} for its channels; save it with one for all")


def _check_mosaic(shape: tuple[int, ...]) -> None:
    if shape != (2, 2):
        size = " x ".join(map(str, shape))
        raise UnreadablePictureError(f"has a mosaic of {size} pixels; only Bayer's of 2 x 2 can be used")


def _pattern(raw: rawpy.RawPy, cell: list[int]) -> str:
    letters = raw.color_desc.decode("ascii", "replace")
    pattern = "".join(letters[colour] for colour in cell)
    if sorted(pattern) != sorted("RGGB"):
        raise UnreadablePictureError(f"has a mosaic of {pattern}; needed are one red, two green and one blue pixel")
    return pattern


def _plain(per_channel: list[int]) -> tuple[float, ...]:
    return (float(per_channel[0]),) * 4


def _white(raw: rawpy.RawPy) -> float:
    """Return the count at which the first channel clips; what the camera itself says comes first."""
    levels = [level for level in raw.camera_white_level_per_channel or [] if level > 0]
    return float(min(levels, default=raw.white_level))
