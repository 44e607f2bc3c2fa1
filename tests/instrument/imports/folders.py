"""Small folders of pictures, one writer for each format."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import OpenEXR
import pytest
import tifffile
from numpy.typing import NDArray
from PIL import Image

from instrument.files.validation import InvalidInputError
from instrument.imports.prepare import prepare_import
from instrument.imports.writing import write_import
from instrument.session.session import Session
from tests.verifying import verify_session

H, W = 48, 64
TIMES = (0.01, 0.1)

# Tags of EXIF and DNG that tifffile writes as they are.
EXPOSURE_TIME, F_NUMBER, ISO, MAKE, MODEL = 33434, 33437, 34855, 271, 272
IDENTITY = tuple(part for value in np.eye(3, dtype=int).ravel() for part in (int(value), 1))


def mosaic(seed: int, bits: int = 12) -> NDArray[np.uint16]:
    """Return counts that use every one of `bits`."""
    counts = np.random.default_rng(seed).integers(0, 1 << bits, (H, W)).astype(np.uint16)
    counts[0, 0], counts[0, 1] = (1 << bits) - 1, 1
    return counts


def write_dng(
    path: Path, counts: NDArray[np.uint16], time: float | None, cell: bytes = b"\0\1\1\2", **levels: Any
) -> Path:
    black, white = levels.get("black", (64, 65, 66, 67)), levels.get("white", 4095)
    tags: list[tuple[Any, ...]] = [
        (33421, "H", 2, (2, 2), True),
        (33422, "B", 4, cell, True),
        (50706, "B", 4, b"\1\4\0\0", True),
        (50707, "B", 4, b"\1\1\0\0", True),
        (50708, "s", 0, "acme pocket", True),
        (50713, "H", 2, (2, 2), True),
        (50714, "H", 4, black, True),
        (50717, "I", 1, white, True),
        (50721, "2i", 9, IDENTITY, True),
        (50728, "2I", 3, (1, 1, 1, 1, 1, 1), True),
        *exif_tags(time),
    ]
    area = levels.get("active_area")
    tags += [(50829, "I", 4, area, True)] if area else []
    tifffile.imwrite(path, counts, photometric=32803, extratags=tags, metadata=None)
    return path


def write_tiff(path: Path, pixels: NDArray[Any], time: float | None) -> Path:
    rgb = pixels.ndim == 3
    photometric = "rgb" if rgb else "minisblack"
    tifffile.imwrite(path, pixels, photometric=photometric, extratags=exif_tags(time), metadata=None)
    return path


def exif_tags(time: float | None, iso: int = 100, f_number: float = 8.0) -> list[tuple[Any, ...]]:
    tags: list[tuple[Any, ...]] = [(MAKE, "s", 0, "acme", True), (MODEL, "s", 0, "pocket", True)]
    tags += [(F_NUMBER, "2I", 1, (round(f_number * 10), 10), True), (ISO, "H", 1, iso, True)]
    return tags + ([] if time is None else [(EXPOSURE_TIME, "2I", 1, (round(time * 1_000_000), 1_000_000), True)])


def write_jpeg(path: Path, pixels: NDArray[np.uint8], time: float | None, **other: Any) -> Path:
    exif = Image.Exif()
    inner = exif.get_ifd(0x8769)
    inner[33437], inner[34855], inner[41987] = (
        other.get("f_number", 8.0),
        other.get("iso", 100),
        other.get("balance", 1),
    )
    if time is not None:
        inner[33434] = time
    Image.fromarray(pixels).save(path, exif=exif, quality=95)
    return path


def write_png(path: Path, pixels: NDArray[Any]) -> Path:
    cv2.imwrite(str(path), pixels[..., ::-1] if pixels.ndim == 3 else pixels)
    return path


def write_exr(path: Path, pixels: NDArray[np.float32], time: float | None = None) -> Path:
    header: dict[str, Any] = {"type": OpenEXR.scanlineimage} | ({} if time is None else {"expTime": time})
    name = "RGB" if pixels.ndim == 3 else "Y"
    with OpenEXR.File(header, {name: np.ascontiguousarray(pixels)}) as file:
        file.write(str(path))
    return path


def write_capture(folder: Path, text: str) -> Path:
    path = folder / "capture.toml"
    path.write_text(text, encoding="utf-8")
    return path


def imported(folder: Path, text: str = 'name = "leaf"\n') -> Session:
    """Import a folder; the session verifies."""
    write_import(prepare_import(folder, write_capture(folder, text)), folder / "s.h5")
    assert list(verify_session(folder / "s.h5")) == []
    return Session(folder / "s.h5")


def refused(folder: Path, text: str) -> str:
    """Return what an import is refused with."""
    with pytest.raises(InvalidInputError) as caught:
        prepare_import(folder, write_capture(folder, text))
    return str(caught.value)
