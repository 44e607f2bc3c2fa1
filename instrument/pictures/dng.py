"""Writes raw frames as DNG, the open RAW format that LibRaw and every RAW converter read."""

from __future__ import annotations

import io
from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray

from instrument.files.whole_file import write_whole
from instrument.session.records import CameraRecord

# code, type, how many, value, whether to write it to the first page: as tifffile takes a tag.
Tag = tuple[int, str, int, Any, bool]

COLOUR_INDEX = {"R": 0, "G": 1, "B": 2}
PHOTOMETRIC, CFA, LINEAR_RAW = 262, 32803, 34892


def write_dng(
    path: Path,
    counts: NDArray[np.uint16],
    exposure_time: float,
    camera: CameraRecord,
    black_level: NDArray[np.float64],
) -> None:
    """Write one frame, uncompressed.

    Parameters
    ----------
    path : Path
    counts : ndarray of uint16, shape (H, W) or (H, W, 3)
    exposure_time : float
        Seconds.
    camera : CameraRecord
    black_level : ndarray, shape (2, 2)
        Counts of darkness at each place of the cell.

    Raises
    ------
    FileExistsError
        If there is something at `path`.
    NotWrittenError
        If the disk or its folder does not take it.
    """
    tags = [*_common_tags(exposure_time, camera), *_levels(camera, black_level), *_colours(camera)]
    options: dict[str, Any] = {"extratags": tags, "metadata": None, "software": "halfangle"}
    # In memory first: a library that writes into a full disk does not say so in one way.
    file = io.BytesIO()
    if camera.bayer_pattern:
        tifffile.imwrite(file, counts, photometric=CFA, **options)
    elif counts.ndim == 3:
        tifffile.imwrite(file, counts, photometric=LINEAR_RAW, planarconfig="contig", **options)
    else:
        tifffile.imwrite(file, counts, photometric="minisblack", **options)
        _declare_linear_raw(file)
    write_whole(path, file.getvalue())


def write_float_tiff(path: Path, values: NDArray[np.float32], exposure_time: float, camera: CameraRecord) -> None:
    """Write values that are no integers, such as a mean of dark frames, as a TIFF of 32-bit floating-point numbers."""
    photometric = "rgb" if values.ndim == 3 else "minisblack"
    tags = [*_time(exposure_time), *_names(camera)]
    file = io.BytesIO()
    tifffile.imwrite(file, values, photometric=photometric, extratags=tags, metadata=None, software="halfangle")
    write_whole(path, file.getvalue())


def _declare_linear_raw(file: io.BytesIO) -> None:
    """Say that a monochrome frame is raw: DNG allows one sample, which tifffile does not write."""
    file.seek(0)
    with tifffile.TiffFile(file) as tiff:
        tiff.pages.first.tags[PHOTOMETRIC].overwrite(LINEAR_RAW)


def _common_tags(exposure_time: float, camera: CameraRecord) -> Iterator[Tag]:
    yield from _names(camera)
    yield from _time(exposure_time)
    yield 50706, "B", 4, b"\1\4\0\0", True  # DNGVersion
    yield 50707, "B", 4, b"\1\1\0\0", True  # DNGBackwardVersion
    yield 50708, "s", 0, _ascii(f"{camera.make} {camera.model}".strip() or "unknown"), True  # UniqueCameraModel
    # Without it LibRaw would cut the border that cameras of this name have.
    yield 50829, "I", 4, (0, 0, camera.height, camera.width), True  # ActiveArea


def _names(camera: CameraRecord) -> Iterator[Tag]:
    for code, text in ((271, camera.make), (272, camera.model), (50735, camera.serial_number)):
        if text:
            yield code, "s", 0, _ascii(text), True


def _time(exposure_time: float) -> Iterator[Tag]:
    ratio = Fraction(exposure_time).limit_denominator(1_000_000)
    yield 33434, "2I", 1, (ratio.numerator, ratio.denominator), True  # ExposureTime


def _levels(camera: CameraRecord, black_level: NDArray[np.float64]) -> Iterator[Tag]:
    if camera.bayer_pattern:
        rationals = tuple(part for level in black_level.ravel() for part in (round(level * 1000), 1000))
        yield 50713, "H", 2, (2, 2), True  # BlackLevelRepeatDim
        yield 50714, "2I", 4, rationals, True  # BlackLevel
    else:
        n = camera.n_channels
        yield 50714, "2I", n, (round(camera.black_level * 1000), 1000) * n, True
    white = int(np.clip(camera.saturation_value, 1, 65535))
    yield 50717, "I", camera.n_channels, (white,) * camera.n_channels, True  # WhiteLevel


def _colours(camera: CameraRecord) -> Iterator[Tag]:
    if camera.bayer_pattern:
        yield 33421, "H", 2, (2, 2), True  # CFARepeatPatternDim
        yield 33422, "B", 4, bytes(COLOUR_INDEX[letter] for letter in camera.bayer_pattern), True  # CFAPattern
    if camera.bayer_pattern or camera.n_channels == 3:
        # Colours as the sensor has them: no one has measured its matrix.
        identity = tuple(part for value in np.eye(3, dtype=int).ravel() for part in (int(value), 1))
        yield 50721, "2i", 9, identity, True  # ColorMatrix1
        yield 50728, "2I", 3, (1, 1, 1, 1, 1, 1), True  # AsShotNeutral
        yield 50778, "H", 1, 21, True  # CalibrationIlluminant1: D65


def _ascii(text: str) -> str:
    """Return a text with a question mark for each letter that a DNG cannot hold; the capture.toml beside it has all."""
    return text.encode("ascii", "replace").decode()
