"""Whether a file itself says that its values are not proportional to light, and by what."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from struct import error as StructError  # noqa: N812, an exception like any other
from struct import unpack_from

import numpy as np
from numpy.typing import NDArray

_LINEAR_GAMMA = 100_000  # of PNG, in units of 1e-5
_LINEAR_TRANSFER = 8  # of ITU-T H.273, which PNG's cICP names
_TOLERANCE = 1e-3


def curve_of_profile(profile: bytes) -> str:
    """Return what an ICC profile says of the curve; ``""`` if values are proportional to light."""
    try:
        curves = [profile[offset : offset + size] for name, offset, size in _entries(profile) if name.endswith(b"TRC")]
        is_linear = bool(curves) and all(_is_linear(curve) for curve in curves)
    except (ValueError, StructError):
        # Damaged: what it said is not known, and somebody has to say it.
        is_linear = False
    return "" if is_linear else "a colour profile with a curve"


def curve_of_png(chunks: Iterable[tuple[bytes, bytes]]) -> str:
    """Return what a PNG file says of its curve; of several chunks that say something the first of these counts."""
    said = dict(reversed(list(chunks)))
    if b"cICP" in said:
        return "" if said[b"cICP"][1] == _LINEAR_TRANSFER else "a transfer function (cICP)"
    if b"iCCP" in said or b"sRGB" in said:
        return "a colour profile" if b"iCCP" in said else "the curve of sRGB"
    if b"gAMA" in said:
        gamma = int.from_bytes(said[b"gAMA"][:4])
        return "" if gamma == _LINEAR_GAMMA else f"a gamma of {gamma / _LINEAR_GAMMA:g}"
    return ""


def is_ramp(values: NDArray[np.float64]) -> bool:
    """Whether a table rises evenly from 0."""
    return bool(np.allclose(values, np.linspace(0.0, values[-1], len(values)), atol=_TOLERANCE * values[-1]))


def _entries(profile: bytes) -> Iterator[tuple[bytes, int, int]]:
    (count,) = unpack_from(">I", profile, 128)
    for i in range(min(count, 100)):
        yield unpack_from(">4sII", profile, 132 + 12 * i)


def _is_linear(curve: bytes) -> bool:
    """Whether a curve of an ICC profile (section 10.6 and 10.18 of ICC.1) is the straight line."""
    if curve[:4] == b"curv":
        (count,) = unpack_from(">I", curve, 8)
        table = np.frombuffer(curve, ">u2", count, 12).astype(np.float64)
        # One number is a power, in steps of 1/256.
        return count == 0 or (is_ramp(table) if count > 1 else float(table[0]) == 256.0)
    if curve[:4] == b"para":
        kind, _, gamma = unpack_from(">HHi", curve, 8)
        return bool(kind == 0 and gamma == 1 << 16)
    return False
