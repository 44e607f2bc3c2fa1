"""Pixel formats: how many bits, which colours, and how counts lie in the bytes of a frame.

References
----------
GenICam Pixel Format Naming Convention 2.4 (EMVA, 2021): unpacked formats are right-aligned in 16 bits, little-endian.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from drivers.errors import DeviceError

_UNPACKED = re.compile(r"(?:Mono|Bayer(?P<first_row>RG|GR|GB|BG))(?P<bits>8|10|12|14|16)")
# The first row says the second, since green stands in both.
_PATTERNS = {"RG": "RGGB", "GR": "GRBG", "GB": "GBRG", "BG": "BGGR"}
_ALLOWED = "allowed are Mono and BayerRG, BayerGR, BayerGB, BayerBG with 8, 10, 12, 14 or 16 bits, e.g. Mono12"


@dataclass(frozen=True, slots=True)
class PixelFormat:
    """A raw format with a count a pixel, in one byte or in two.

    Attributes
    ----------
    name : str
        As GenICam writes it, e.g. ``"BayerRG12"``.
    bit_depth : int
    bayer_pattern : str
        In reading order; ``""`` for monochrome.
    """

    name: str
    bit_depth: int
    bayer_pattern: str

    @property
    def dtype(self) -> np.dtype[np.uint8 | np.uint16]:
        """How a count is stored."""
        return np.dtype("u1") if self.bit_depth == 8 else np.dtype("<u2")

    def counts(self, data: bytes, height: int, width: int) -> NDArray[np.uint16]:
        """Return the counts of a frame, shape (height, width).

        Raises
        ------
        DeviceError
            If the frame has fewer bytes than that, or a count more bits than the format.
        """
        n_bytes = height * width * self.dtype.itemsize
        if len(data) < n_bytes:
            raise DeviceError(
                f"the frame has {len(data)} bytes; {width} x {height} pixels of {self.name} are {n_bytes}. "
                "Take it again"
            )
        counts = np.frombuffer(data, self.dtype, height * width).reshape(height, width).astype(np.uint16)
        highest = int(counts.max(initial=0))
        if highest >= 1 << self.bit_depth:
            raise DeviceError(
                f"a count of the frame is {highest}; {self.name} ends at {(1 << self.bit_depth) - 1}. "
                "The camera aligns its counts in another way: set pixel_format to one with 16 bits"
            )
        return counts


def raw_format(name: str) -> PixelFormat:
    """Return the raw format of a name.

    Raises
    ------
    ValueError
        If it is packed, processed (RGB, YUV) or unknown.
    """
    found = _UNPACKED.fullmatch(name)
    if found is None:
        why = "is packed" if re.fullmatch(r"(Mono|Bayer..)\d+(p|Packed)", name) else "is no raw format"
        raise ValueError(f"pixel_format is {name!r}, which {why}; {_ALLOWED}")
    return PixelFormat(name, int(found["bits"]), _PATTERNS.get(found["first_row"] or "", ""))


def deepest(names: Iterable[str]) -> PixelFormat:
    """Return the raw format with most bits; of two with as many the one in colours, since a sum of colours is not raw.

    Raises
    ------
    DeviceError
        If none is raw and unpacked.
    """
    listed = sorted(names)
    formats = [raw_format(name) for name in listed if _UNPACKED.fullmatch(name)]
    if not formats:
        raise DeviceError(f"the camera has the pixel formats {', '.join(listed) or 'none'}; {_ALLOWED}")
    return max(formats, key=lambda each: (each.bit_depth, each.bayer_pattern))


def shifted_pattern(pattern: str, offset_x: int, offset_y: int) -> str:
    """Return the colours of the 2 x 2 cell that begins `offset_x` columns and `offset_y` rows further on."""
    if not pattern:
        return ""
    return "".join(pattern[2 * ((y + offset_y) % 2) + (x + offset_x) % 2] for y in (0, 1) for x in (0, 1))
