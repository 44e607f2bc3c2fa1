"""Reads Windows' `.bmp` files, uncompressed, of grey, of a palette, or of red, green and blue."""

from __future__ import annotations

from pathlib import Path
from struct import error as StructError  # noqa: N812, an exception like any other
from struct import unpack_from
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instrument.pictures.picture import Picture, UnreadablePictureError, without_alpha

_RGB, _BITFIELDS = 0, 3
_COMPRESSIONS = {1: "RLE8", 2: "RLE4", 4: "JPEG", 5: "PNG", 6: "BITFIELDS with transparency"}
_USUAL_MASKS = (0xFF0000, 0xFF00, 0xFF)
_OLDEST_HEADER = 12


def read_bmp(path: Path) -> Picture:
    """Read a bitmap of 8 bits a colour."""
    content = path.read_bytes()
    try:
        return Picture(_pixels(content), bayer_pattern=None)
    except StructError:
        raise UnreadablePictureError("is damaged or cut short") from None


def _pixels(content: bytes) -> NDArray[np.uint8]:
    if content[:2] != b"BM":
        raise UnreadablePictureError("is no bitmap, or damaged: it does not begin with BM")
    start, header = unpack_from("<II", content, 10)
    if header == _OLDEST_HEADER:
        width, height, _, bits = unpack_from("<HHHH", content, 18)
        compression = n_colours = 0
    else:
        width, height, _, bits, compression = unpack_from("<iiHHI", content, 18)
        (n_colours,) = unpack_from("<I", content, 46)
    _refuse_other_kinds(content, bits, compression)
    rows = _rows(content, start, abs(height), width, bits)
    # The bottom row comes first, unless the height is negative.
    rows = rows if height < 0 else rows[::-1]
    if bits <= 8:
        size = 3 if header == _OLDEST_HEADER else 4
        return _coloured(rows, content[14 + header : start], size, n_colours or 1 << bits)
    # Blue, green, red, and a fourth that some programs leave 0 and others use for transparency.
    colours = rows[..., 2::-1]
    if bits == 32 and rows[..., 3].any():
        return without_alpha(np.concatenate([colours, rows[..., 3:]], axis=-1))
    return colours


def _refuse_other_kinds(content: bytes, bits: int, compression: int) -> None:
    if compression not in (_RGB, _BITFIELDS):
        name = _COMPRESSIONS.get(compression, f"number {compression}")
        raise UnreadablePictureError(f"is compressed ({name}); save it uncompressed, or as PNG")
    if bits not in (1, 4, 8, 24, 32):
        raise UnreadablePictureError(f"has {bits} bits for all colours of a pixel; save it with 24, or as PNG")
    if compression == _BITFIELDS and (bits != 32 or unpack_from("<III", content, 54) != _USUAL_MASKS):
        raise UnreadablePictureError("has colours of other than 8 bits each, or in another order; save it as PNG")


def _rows(content: bytes, start: int, height: int, width: int, bits: int) -> NDArray[np.uint8]:
    """Return what is stored, shape (height, width) or (height, width, bytes of a pixel)."""
    # Each row ends at a multiple of four bytes.
    stride = (width * bits + 31) // 32 * 4
    if width <= 0 or height <= 0 or start + stride * height > len(content):
        raise UnreadablePictureError(f"is damaged or cut short: its header states {width} x {height} pixels")
    stored = np.frombuffer(content, np.uint8, stride * height, start).reshape(height, stride)
    if bits >= 24:
        return stored[:, : width * bits // 8].reshape(height, width, bits // 8)
    each = np.unpackbits(stored, axis=1).reshape(height, -1, bits)[:, :width]
    return np.packbits(each, axis=-1)[..., 0] >> np.uint8(8 - bits)


def _coloured(index: NDArray[np.uint8], table: bytes, size: int, n_colours: int) -> NDArray[Any]:
    """Return the colours of a palette; one channel if all of them are grey."""
    if len(table) < size * n_colours or index.max() >= n_colours:
        raise UnreadablePictureError("is damaged: its palette has fewer colours than its pixels")
    colours = np.frombuffer(table, np.uint8, size * n_colours).reshape(n_colours, size)[:, 2::-1]
    is_grey = (colours == colours[:, :1]).all()
    return colours[index, 0] if is_grey else colours[index]
