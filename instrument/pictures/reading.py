"""Reads a picture of any known kind."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from instrument.pictures.bitmap_file import read_bmp
from instrument.pictures.formats import read_exr, read_jpeg, read_npy, read_pfm, read_png
from instrument.pictures.heif_file import read_heif
from instrument.pictures.picture import Picture, Reader, UnreadablePictureError, checked
from instrument.pictures.radiance_file import read_hdr
from instrument.pictures.raw_file import read_dng, read_raw
from instrument.pictures.tiff_file import read_tiff

# Of a folder that holds several kinds of the same pictures, the first of these is closest to the sensor.
READERS: dict[str, Reader] = {
    ".tif": read_tiff,
    ".tiff": read_tiff,
    ".exr": read_exr,
    ".hdr": read_hdr,
    ".pfm": read_pfm,
    ".npy": read_npy,
    ".png": read_png,
    ".bmp": read_bmp,
    ".jpg": read_jpeg,
    ".jpeg": read_jpeg,
    ".heic": read_heif,
    ".heif": read_heif,
}

LINEAR_SUFFIXES = (".exr", ".hdr", ".pfm", ".npy")
"""Kinds whose values are proportional to light by what the kind is."""

# Of the cameras that LibRaw reads; another name is given to it, too, when a capture.toml states it in full.
_RAW = "dng cr2 cr3 crw nef nrw arw sr2 srf orf rw2 raf pef srw rwl 3fr fff iiq mos mef mrw dcr kdc erf x3f raw gpr"
RAW_SUFFIXES = tuple(f".{name}" for name in _RAW.split())

VIDEO_SUFFIXES = (".mp4", ".mov", ".m4v", ".avi", ".mkv", ".webm")

KNOWN_KINDS = f"RAW files of cameras ({', '.join(RAW_SUFFIXES[:6])} ...) and {', '.join(READERS)}"

VIDEO_REMEDY = (
    "is a video; make pictures of it: ffmpeg -i VIDEO -vf fps=2 frames/%04d.png, and import the folder. Lock exposure, "
    "focus and white balance before you film; 8 bits, compression and a curve that nobody states make results coarser "
    "than those of single pictures"
)


def is_picture(path: Path) -> bool:
    """Whether the name of a file is that of a picture; hidden ones, such as a Mac's `._IMG_0.dng`, are none."""
    return not path.name.startswith(".") and path.suffix.lower() in (*READERS, *RAW_SUFFIXES)


def is_raw(path: Path) -> bool:
    """Whether LibRaw is to read a file."""
    return path.suffix.lower() not in READERS


def why_no_folder(path: Path) -> str:
    """Return why a path is no folder of pictures."""
    if not path.exists():
        return "is no folder"
    if path.suffix.lower() in VIDEO_SUFFIXES:
        return VIDEO_REMEDY
    return "is a file; name the folder that holds the pictures"


def read_picture(path: Path) -> Picture:
    """Read a picture.

    Raises
    ------
    UnreadablePictureError
        Whatever the libraries find wrong with the file.
    """
    suffix = path.suffix.lower()
    if suffix in VIDEO_SUFFIXES:
        raise UnreadablePictureError(VIDEO_REMEDY)
    try:
        return checked(_reader(suffix)(path))
    except UnreadablePictureError:
        raise
    except Exception as error:
        # A damaged file makes the libraries raise almost anything.
        known = "" if suffix in (*READERS, *RAW_SUFFIXES) else f"; known are {KNOWN_KINDS}"
        what = f"cannot be read: {_reason(error.args) or type(error).__name__}{known}"
        raise UnreadablePictureError(what) from error


def _reader(suffix: str) -> Reader:
    return read_dng if suffix == ".dng" else READERS.get(suffix, read_raw)


def _reason(arguments: Sequence[object]) -> str:
    texts = (part.decode("utf-8", "replace") if isinstance(part, bytes) else str(part) for part in arguments)
    return " ".join(texts).strip()
