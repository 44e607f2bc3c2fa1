"""Reads RAW files of cameras with LibRaw: the sensor's own counts, before anything is done to them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import rawpy
import tifffile
from numpy.typing import NDArray

from instrument.pictures.picture import Picture, UnreadablePictureError

RAW_KINDS = (tifffile.PHOTOMETRIC.CFA, tifffile.PHOTOMETRIC.LINEAR_RAW)
_BLACK_REPEAT, _BLACK_LEVEL = 50713, 50714
_ACTIVE_AREA, _CFA_PATTERN, _CFA_LAYOUT, _DELTA_ACROSS, _DELTA_DOWN = 50829, 33422, 50711, 50715, 50716
_OPCODE_LISTS = (51008, 51009, 51022)

# Opcodes of DNG that map values, so that counts without them are no light; those that correct a lens are left off.
_MAPPING_OPCODES = {
    7: "MapTable",
    8: "MapPolynomial",
    10: "DeltaPerRow",
    11: "DeltaPerColumn",
    12: "ScalePerRow",
    13: "ScalePerColumn",
}


def read_raw(path: Path) -> Picture:
    """Read the visible part of a RAW file; masked borders of the sensor are left out."""
    with rawpy.imread(str(path)) as raw:
        return _visible(raw)


def read_dng(path: Path) -> Picture:
    """Read a DNG file as `read_raw` does, if LibRaw hands on all that its header says of the values.

    Black levels are those of the header: LibRaw makes whole numbers of them, and leaves the levels of a cell where
    they are when it leaves out one more row or column of the active area.
    """
    with tifffile.TiffFile(path) as file:
        pages = [page for first in file.pages for page in (first, *(first.pages or ()))]
        raw_tags = [page.tags for page in pages if page.tags.valueof("PhotometricInterpretation") in RAW_KINDS]
        for tags in raw_tags:
            _refuse_meanings(tags)
        orientation = int(file.pages.first.tags.valueof("Orientation", default=1))
        cells = {_cell(tags) for tags in raw_tags if _BLACK_LEVEL in tags}
    if len(cells) > 1:
        raise UnreadablePictureError(f"holds {len(raw_tags)} raw pictures of different black levels; save one alone")
    with rawpy.imread(str(path)) as raw:
        picture, top, left = _visible(raw), raw.sizes.top_margin, raw.sizes.left_margin
    black = _moved(cells.pop(), top, left) if cells else picture.black_level
    return replace(picture, orientation=orientation, black_level=black)


def _visible(raw: rawpy.RawPy) -> Picture:
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


def _refuse_meanings(tags: tifffile.TiffTags) -> None:
    """Raise `UnreadablePictureError` for a DNG whose values or black levels LibRaw does not hand on as they are.

    LibRaw scales floating-point values to each file's own maximum, so that frames of one bracket no longer compare;
    it hands on one black level for all channels of a linear DNG, none of patterns larger than the cell, and of black
    levels of rows and columns their mean.
    """
    formats = np.ravel(tags.valueof("SampleFormat", default=1))
    if np.any(formats == tifffile.SAMPLEFORMAT.IEEEFP):
        raise UnreadablePictureError(
            "holds floating-point values, each file scaled to its own maximum when it is read; save it as EXR or TIFF"
        )
    if np.any(formats != tifffile.SAMPLEFORMAT.UINT):
        raise UnreadablePictureError("holds whole numbers with a sign; save it without")
    rows, columns = np.ravel(tags.valueof(_BLACK_REPEAT, default=(1, 1)))[:2]
    if (rows, columns) not in {(1, 1), (2, 2)}:
        raise UnreadablePictureError(f"has black levels in a pattern of {rows} x {columns}; usable are 1 and 2 x 2")
    is_linear = tags.valueof("PhotometricInterpretation") == tifffile.PHOTOMETRIC.LINEAR_RAW
    black = _black_levels(tags)
    samples = int(np.ravel(tags.valueof("SamplesPerPixel", default=1))[0])
    if black.size not in (1, rows * columns * samples):
        raise UnreadablePictureError(f"has {black.size} black levels for a pattern of {rows} x {columns}; state each")
    if is_linear and np.unique(black).size > 1:
        levels = ", ".join(f"{level:g}" for level in black)
        raise UnreadablePictureError(f"has black levels {levels} for its channels; save it with one for all")
    if any(np.any(_numbers(tags, code)) for code in (_DELTA_ACROSS, _DELTA_DOWN)):
        raise UnreadablePictureError("has black levels of its own for rows or columns; save it without")
    if not is_linear and _CFA_PATTERN not in tags:
        # LibRaw would guess.
        raise UnreadablePictureError(
            "does not say of which colours its mosaic is; state CFAPattern, or save it as grey"
        )
    if tags.valueof(_CFA_LAYOUT, default=1) != 1:
        raise UnreadablePictureError("has a mosaic in staggered rows or columns; needed are rectangular ones")
    opcodes = {number for code in _OPCODE_LISTS for number in _opcodes(tags.valueof(code, default=b""))}
    if names := [name for number, name in _MAPPING_OPCODES.items() if number in opcodes]:
        raise UnreadablePictureError(f"asks for its values to be mapped ({', '.join(names)}); save it with that done")


def _black_levels(tags: tifffile.TiffTags) -> NDArray[np.float64]:
    return _numbers(tags, _BLACK_LEVEL)


def _numbers(tags: tifffile.TiffTags, code: int) -> NDArray[np.float64]:
    """Return the numbers of a tag; 0 if it is not there."""
    tag: Any = tags.get(code)
    if tag is None:
        return np.zeros(1)
    values = np.ravel(tag.value).astype(np.float64)
    # Rational numbers come as numerator and denominator.
    is_rational = tag.dtype in (tifffile.DATATYPE.RATIONAL, tifffile.DATATYPE.SRATIONAL)
    return values[::2] / values[1::2] if is_rational else values


def _opcodes(content: Any) -> Iterator[int]:
    """Yield the opcodes in a list of a DNG: how many, then of each number, version, flags, size and parameters."""
    data, position = bytes(content), 4
    for _ in range(int.from_bytes(data[:4])):
        if position >= len(data):
            return
        yield int.from_bytes(data[position : position + 4])
        position += 16 + int.from_bytes(data[position + 12 : position + 16])


def _cell(tags: tifffile.TiffTags) -> tuple[float, ...]:
    """Return the black levels of a header for the cell that begins at the sensor's first pixel."""
    black = _black_levels(tags)
    if black.size != 4:
        return (float(black[0]),) * 4  # one for all, or else it has been refused
    # The cell of the header begins at the active area.
    top, left = tags.valueof(_ACTIVE_AREA, default=(0, 0))[:2]
    return _moved(tuple(black.tolist()), -top, -left)


def _moved(cell: tuple[float, ...], rows: int, columns: int) -> tuple[float, ...]:
    """Return a cell as it is where one begins so many rows down and columns to the right."""
    return tuple(np.roll(np.reshape(cell, (2, 2)), (-rows, -columns), axis=(0, 1)).ravel().tolist())


def _check_mosaic(shape: tuple[int, ...]) -> None:
    if shape != (2, 2):
        size = " x ".join(map(str, shape))
        what = f"has a mosaic of {size} pixels; only Bayer's of 2 x 2 can be used. A linear DNG made of it can be read"
        raise UnreadablePictureError(what)


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
