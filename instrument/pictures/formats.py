"""Reads PNG, JPEG, EXR, PFM and NumPy files as they are: no scaling, no rotation, no colour management."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
from numpy.typing import NDArray
from PIL import Image

from instrument.pictures.picture import Picture, UnreadablePictureError, without_alpha
from instrument.pictures.stated_curve import curve_of_png

# Pillow's own limit is that of a suspicious web page; a phone exceeds it.
Image.MAX_IMAGE_PIXELS = 1_000_000_000

_ORIENTATION = 274

_PNG_COLOURS, _PNG_GREY = 9, 0
"""Where a PNG file's first part says of which colours it is, and what it says there."""

_PFM_HEADER = re.compile(rb"(PF|Pf)\s+(\d+)\s+(\d+)\s+(\S+)(?:\r\n|\s)")


def read_png(path: Path) -> Picture:
    """Read a PNG file; OpenCV takes all depths, Pillow checks that every part is whole."""
    with Image.open(path) as file:
        if getattr(file, "n_frames", 1) > 1:
            raise UnreadablePictureError("moves: it holds several pictures; save each in a file of its own")
        file.verify()
    chunks = list(_png_chunks(path.read_bytes()))
    said = dict(chunks)
    if b"tRNS" in said and said[b"IHDR"][_PNG_COLOURS] == _PNG_GREY:
        # OpenCV does not say so.
        raise UnreadablePictureError("is transparent where it has one of its greys; flatten it")
    exif = Image.Exif()
    exif.load(said.get(b"eXIf", b""))
    return Picture(
        read_with_opencv(path),
        bayer_pattern=None,
        orientation=exif.get(_ORIENTATION, 1),
        curve=curve_of_png(chunks),
    )


def read_jpeg(path: Path) -> Picture:
    """Read a JPEG file; by Pillow, since OpenCV fills what is missing of a truncated one with grey."""
    with Image.open(path) as file:
        if file.mode not in ("L", "RGB"):
            raise UnreadablePictureError(f"has colours of the kind {file.mode}; save it as RGB or grey")
        file.load()
        return Picture(np.asarray(file), bayer_pattern="", orientation=file.getexif().get(_ORIENTATION, 1))


def read_exr(path: Path) -> Picture:
    """Read the one part of an EXR file that has R, G and B, or Y."""
    with OpenEXR.File(str(path), separate_channels=True) as file:
        if not file.parts:
            raise UnreadablePictureError("is damaged or cut short")
        parts = [i for i in range(len(file.parts)) if _colours(file.channels(i))]
        if not parts:
            names = ", ".join(sorted({name for i in range(len(file.parts)) for name in file.channels(i)}))
            raise UnreadablePictureError(f"has the channels {names}; needed are R, G, B or Y")
        if len(parts) > 1:
            raise UnreadablePictureError(f"holds {len(parts)} pictures; save each in a file of its own")
        channels = file.channels(parts[0])
        _refuse_parts_of_pictures(channels, file.header(parts[0]))
        colours = _colours(channels)
        planes = [np.asarray(channels[name].pixels) for name in (*colours, *({"A"} & set(channels)))]
        if any(plane.dtype.kind != "f" for plane in planes):
            raise UnreadablePictureError("has whole numbers; save it with floating-point numbers")
        pixels = np.stack(planes, axis=-1)
        return Picture(without_alpha(pixels), bayer_pattern="" if colours == "RGB" else None)


def read_pfm(path: Path) -> Picture:
    """Read a portable float map, whose bottom row comes first.

    References
    ----------
    Paul Debevec, PFM Portable FloatMap Image Format.
    """
    content = path.read_bytes()
    match = _PFM_HEADER.match(content)
    if match is None:
        raise UnreadablePictureError("is no portable float map, or damaged: it does not begin with PF or Pf and a size")
    width, height, scale = int(match[2]), int(match[3]), float(match[4])
    # Some programs multiply by it and others divide.
    if abs(scale) != 1.0:
        raise UnreadablePictureError(f"states the scale {scale:g}, which has no common meaning; save it with 1 or -1")
    channels = 3 if match[1] == b"PF" else 1
    data = content[match.end() :]
    if len(data) != 4 * width * height * channels:
        raise UnreadablePictureError(f"is damaged or cut short: its header states {width} x {height} pixels")
    pixels = np.frombuffer(data, "<f4" if scale < 0 else ">f4").reshape(height, width, channels)
    return Picture(pixels[::-1], bayer_pattern="" if channels == 3 else None)


def read_npy(path: Path) -> Picture:
    """Read an array that NumPy saved."""
    return Picture(np.load(path, allow_pickle=False))


def read_with_opencv(path: Path) -> NDArray[Any]:
    """Return what OpenCV reads: one channel, or red, green and blue.

    Raises
    ------
    UnreadablePictureError
        If it reads nothing, or the picture is transparent.
    """
    pixels = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if pixels is None:
        raise UnreadablePictureError("is no picture, or damaged")
    # Blue, green, red, alpha in OpenCV.
    pixels = without_alpha(pixels)
    return pixels[..., ::-1] if pixels.ndim == 3 and pixels.shape[2] == 3 else pixels


def _png_chunks(content: bytes) -> Iterator[tuple[bytes, bytes]]:
    """Yield the name and content of each part of a PNG file that is known to be whole."""
    position = 8
    while position + 8 <= len(content):
        length = int.from_bytes(content[position : position + 4])
        yield content[position + 4 : position + 8], content[position + 8 : position + 8 + length]
        position += length + 12


def _colours(channels: dict[str, Any]) -> str:
    """Return the names of the channels that are the picture, a letter each; ``""`` if there are none."""
    return next((names for names in ("RGB", "Y") if set(names) <= set(channels)), "")


def _refuse_parts_of_pictures(channels: dict[str, Any], header: dict[str, Any]) -> None:
    """Raise `UnreadablePictureError` where the picture of an EXR file is more, or less, than its channels."""
    if {"RY", "BY"} & set(channels):
        raise UnreadablePictureError("has colours as Y, RY and BY; save it as R, G and B")
    # Windows of one size that lie elsewhere would shift a picture against the others.
    if not np.array_equal(header["dataWindow"], header["displayWindow"]):
        raise UnreadablePictureError("has a data window that is not its display window; save it whole")
    if any(channel.xSampling != 1 or channel.ySampling != 1 for channel in channels.values()):
        raise UnreadablePictureError("has channels of fewer pixels; save it with all of them")
