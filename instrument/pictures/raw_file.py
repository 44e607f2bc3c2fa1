"""Reads RAW files of cameras with LibRaw: the sensor's own counts, before anything is done to them."""

from __future__ import annotations

from pathlib import Path

import rawpy

from instrument.pictures.picture import Picture, UnreadablePictureError


def read_raw(path: Path) -> Picture:
    """Read the visible part of a RAW file; masked borders of the sensor are left out."""
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
