"""Reads how a picture was taken from its EXIF data."""

from __future__ import annotations

import io
import logging
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import exifread
import OpenEXR
import rawpy

from instrument.pictures.heif_file import HEIF_SUFFIXES, heif_exif
from instrument.pictures.reading import is_raw

# It reports files without EXIF as warnings; here that is no news.
logging.getLogger("exifread").setLevel(logging.CRITICAL)


@dataclass(frozen=True, slots=True)
class Shot:
    """How a picture was taken; None or ``""`` where its file does not say.

    Attributes
    ----------
    exposure_time : float or None
        Seconds.
    iso, f_number : float or None
        Gain setting and aperture.
    focal_length, focal_length_35mm : float or None
        mm, and the mm of a lens with the same view on a frame of 36 mm width.
    make, model, serial_number, white_balance : str
    """

    exposure_time: float | None = None
    iso: float | None = None
    f_number: float | None = None
    focal_length: float | None = None
    focal_length_35mm: float | None = None
    make: str = ""
    model: str = ""
    serial_number: str = ""
    white_balance: str = ""


def read_shot(path: Path) -> Shot:
    """Return how a picture was taken, as far as its file says; damage counts as silence."""
    try:
        return _from_exr(path) if path.suffix.lower() == ".exr" else _from_exif(path)
    except Exception:
        # Like the pixels' readers: a damaged header may raise anything. The pixels tell whether the file is good.
        return Shot()


def _from_exif(path: Path) -> Shot:
    with io.BytesIO(heif_exif(path)) if path.suffix.lower() in HEIF_SUFFIXES else path.open("rb") as file:
        tags = exifread.process_file(file, details=False)
    if not tags and is_raw(path):
        return _from_libraw(path)
    return Shot(
        exposure_time=_number(tags, "EXIF ExposureTime", "Image ExposureTime") or _apex_time(tags),
        iso=_number(tags, "EXIF ISOSpeedRatings", "Image ISOSpeedRatings"),
        f_number=_number(tags, "EXIF FNumber", "Image FNumber"),
        focal_length=_number(tags, "EXIF FocalLength", "Image FocalLength"),
        focal_length_35mm=_number(tags, "EXIF FocalLengthIn35mmFilm"),
        make=_text(tags, "Image Make"),
        model=_text(tags, "Image Model"),
        serial_number=_text(tags, "EXIF BodySerialNumber", "Image CameraSerialNumber"),
        white_balance=_text(tags, "EXIF WhiteBalance"),
    )


def _from_libraw(path: Path) -> Shot:
    """Return what LibRaw knows of a RAW file whose container hides its EXIF, in LibRaw's single precision."""
    with rawpy.imread(str(path)) as raw:
        told = raw.other
    time, iso, aperture, focal = (
        _positive(f"{value:.6g}") for value in (told.shutter_speed, told.iso_speed, told.aperture, told.focal_length)
    )
    return Shot(exposure_time=time, iso=iso, f_number=aperture, focal_length=focal)


def _from_exr(path: Path) -> Shot:
    """Return the standard attributes of an EXR file."""
    with OpenEXR.File(str(path), header_only=True) as file:
        # The header is emptied when the file is closed.
        header = dict(file.header())
    time, iso, aperture = (_positive(header.get(name)) for name in ("expTime", "isoSpeed", "aperture"))
    return Shot(exposure_time=time, iso=iso, f_number=aperture)


def _number(tags: Mapping[str, Any], *names: str) -> float | None:
    """Return the first value that stands under one of `names`; cameras write 0 for "not known"."""
    values = (tags[name].values for name in names if name in tags)
    return _positive(next((value[0] for value in values if value), None))


def _apex_time(tags: Mapping[str, Any]) -> float | None:
    """Return the exposure time that ShutterSpeedValue states: T_v of the APEX system, t = 2^-T_v seconds."""
    for name in ("EXIF ShutterSpeedValue", "Image ShutterSpeedValue"):
        values = tags[name].values if name in tags else None
        if values:
            try:
                return _positive(2.0 ** -float(values[0]))
            except (TypeError, ValueError, ZeroDivisionError, OverflowError):
                return None
    return None


def _positive(value: Any) -> float | None:
    try:
        # Floating-point values come wrapped in a tuple each.
        number = float(value[0] if isinstance(value, tuple) else value)
    except (TypeError, ValueError, ZeroDivisionError):
        return None
    return number if 0 < number < float("inf") else None


def _text(tags: Mapping[str, Any], *names: str) -> str:
    return next((str(tags[name].printable).strip() for name in names if name in tags), "")
