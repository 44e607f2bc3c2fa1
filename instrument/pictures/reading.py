"""Reads a picture of any known kind."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from instrument.pictures.formats import read_exr, read_jpeg, read_npy, read_png, read_tiff
from instrument.pictures.picture import Picture, Reader, UnreadablePictureError, checked
from instrument.pictures.raw_file import read_raw

READERS: dict[str, Reader] = {
    ".tif": read_tiff,
    ".tiff": read_tiff,
    ".png": read_png,
    ".jpg": read_jpeg,
    ".jpeg": read_jpeg,
    ".exr": read_exr,
    ".npy": read_npy,
}

# Of the cameras that LibRaw reads; another name is given to it, too, when a capture.toml states it in full.
_RAW = "dng cr2 cr3 crw nef nrw arw sr2 srf orf rw2 raf pef srw rwl 3fr fff iiq mos mef mrw dcr kdc erf x3f raw gpr"
RAW_SUFFIXES = tuple(f".{name}" for name in _RAW.split())


def is_picture(path: Path) -> bool:
    """Whether the name of a file is that of a picture; hidden ones, such as a Mac's `._IMG_0.dng`, are none."""
    return not path.name.startswith(".") and path.suffix.lower() in (*READERS, *RAW_SUFFIXES)


def is_raw(path: Path) -> bool:
    """Whether LibRaw is to read a file."""
    return path.suffix.lower() not in READERS


def read_picture(path: Path) -> Picture:
    """Read a picture.

    Raises
    ------
    UnreadablePictureError
        Whatever the libraries find wrong with the file.
    """
    try:
        return checked(READERS.get(path.suffix.lower(), read_raw)(path))
    except UnreadablePictureError:
        raise
    except Exception as error:
        # A damaged file makes the libraries raise almost anything.
        raise UnreadablePictureError(f"cannot be read: {_reason(error.args) or type(error).__name__}") from error


def _reason(arguments: Sequence[object]) -> str:
    texts = (part.decode("utf-8", "replace") if isinstance(part, bytes) else str(part) for part in arguments)
    return " ".join(texts).strip()
