"""Reads every picture once before anything is written: whether it is whole, and what it is."""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

import numpy as np

from instrument.pictures.exif import Shot, read_shot
from instrument.pictures.picture import Picture, UnreadablePictureError
from instrument.pictures.reading import read_picture

Watcher = Callable[[int, int, str], None]


@dataclass(frozen=True, slots=True)
class Surveyed:
    """What one file holds.

    Attributes
    ----------
    sha256 : str
        Hex digest of the file.
    shot : Shot
    shape : tuple of int
        (H, W) or (H, W, 3).
    dtype : str
        ``"u1"``, ``"u2"`` or ``"f4"``.
    any_bits : int
        Bits that are set in at least one pixel; 0 for floating-point numbers.
    bayer_pattern, black_level, saturation_level, curve
        As in `Picture`.
    """

    sha256: str
    shot: Shot
    shape: tuple[int, ...]
    dtype: str
    any_bits: int
    bayer_pattern: str | None
    black_level: tuple[float, ...] | None
    saturation_level: float | None
    curve: str


def survey(paths: Collection[Path], watch: Watcher) -> tuple[dict[Path, Surveyed], dict[Path, str]]:
    """Return what each file holds, and for those that cannot be used why not."""
    good: dict[Path, Surveyed] = {}
    bad: dict[Path, str] = {}
    for i, path in enumerate(paths):
        watch(i, len(paths), path.name)
        try:
            good[path] = look_at(path)
        except UnreadablePictureError as error:
            bad[path] = str(error)
    return good, bad


def look_at(path: Path) -> Surveyed:
    """Return what a file holds.

    Raises
    ------
    UnreadablePictureError
    """
    picture = read_picture(path)
    return _surveyed(picture, path)


def _surveyed(picture: Picture, path: Path) -> Surveyed:
    pixels = picture.pixels
    return Surveyed(
        sha256=_digest(path),
        shot=read_shot(path),
        shape=pixels.shape,
        dtype=pixels.dtype.str[1:],
        any_bits=int(np.bitwise_or.reduce(pixels, axis=None)) if pixels.dtype.kind == "u" else 0,
        bayer_pattern=picture.bayer_pattern,
        black_level=picture.black_level,
        saturation_level=picture.saturation_level,
        curve=picture.curve,
    )


def _digest(path: Path) -> str:
    digest = sha256()
    with path.open("rb") as file:
        while block := file.read(1 << 20):
            digest.update(block)
    return digest.hexdigest()
