"""Reads the `.heic` and `.heif` files of phones as their sensor lay: unrotated."""

from __future__ import annotations

import re
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instrument.pictures.picture import Picture, UnreadablePictureError, without_alpha

HEIF_SUFFIXES = (".heic", ".heif")

# Boxes of a file that say how its picture is turned, by quarters against the clock, and mirrored.
_TURN, _MIRROR = re.compile(rb"\0\0\0\x09irot(.)", re.DOTALL), b"\0\0\0\x09imir"

_ORIENTATIONS = (1, 8, 3, 6)
"""EXIF's numbers of those quarters."""


def heif_exif(path: Path) -> bytes:
    """Return the EXIF data of a file, which are those of a TIFF file without a picture."""
    data: bytes = _library().open_heif(path).info.get("exif") or b""
    return data.removeprefix(b"Exif\0\0")


def read_heif(path: Path) -> Picture:
    """Read the one picture of a file, of 8 bits a colour."""
    library, content = _library(), path.read_bytes()
    turn = _turn(content)
    file = library.open_heif(content, convert_hdr_to_8bit=False)
    if len(file) > 1:
        raise UnreadablePictureError(f"holds {len(file)} pictures; save each in a file of its own")
    if (bits := file.info.get("bit_depth", 8)) != 8:
        raise UnreadablePictureError(f"has {bits} bits and a curve for bright displays; save it as JPEG, or take RAW")
    pixels: NDArray[Any] = np.asarray(file[0])
    # The library turns pictures; those of one lens belong together as the sensor saw them.
    return Picture(without_alpha(np.rot90(pixels, -turn)), bayer_pattern="", orientation=_ORIENTATIONS[turn])


def _library() -> Any:
    try:
        return import_module("pillow_heif")
    except ImportError:
        what = "is HEIF, which needs the extra halfangle[heif]; or save it as JPEG or PNG"
        raise UnreadablePictureError(what) from None


def _turn(content: bytes) -> int:
    """Return by how many quarters, against the clock, the picture is turned when it is shown."""
    if _MIRROR in content:
        raise UnreadablePictureError("is stored mirrored; save it upright")
    turns = {quarters[0] & 3 for quarters in _TURN.findall(content)}
    if len(turns) > 1:
        raise UnreadablePictureError("holds pictures that are turned differently; save it as JPEG")
    return turns.pop() if turns else 0
