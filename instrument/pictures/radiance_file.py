"""Reads Radiance's `.hdr` files: three mantissas of 8 bits with one exponent a pixel."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from instrument.pictures.picture import Picture, UnreadablePictureError

_RESOLUTION = re.compile(rb"([-+])([XY]) +(\d+) +([-+])([XY]) +(\d+)\s*")
_MOST_PIXELS = 1_000_000_000
_RUN = 128  # longer counts stand for a run of one value


def read_hdr(path: Path) -> Picture:
    """Read a Radiance picture of red, green and blue, upright, in the unit that it had before any exposure.

    References
    ----------
    The file formats of Radiance, ``ray/doc/filefmts.pdf``, and its reader ``ray/src/common/color.c``.
    """
    content = path.read_bytes()
    lines, start = _header(content)
    factors = _factors(lines)
    match = _RESOLUTION.fullmatch(content[start : content.find(b"\n", start) + 1])
    if match is None or match[2] == match[5]:
        raise UnreadablePictureError("is damaged: its header states no size")
    n_lines, length = int(match[3]), int(match[6])
    if not 0 < n_lines * length <= _MOST_PIXELS:
        raise UnreadablePictureError(f"is damaged: its header states {length} x {n_lines} pixels")
    stored = _decoded(content, match.end() + start, n_lines, length)
    # The middle of the step, as Radiance has it: writers cut mantissas off.
    values = np.ldexp(stored[..., :3] + np.float32(0.5), stored[..., 3:].astype(np.int32) - 136)
    values[stored[..., 3] == 0] = 0.0
    return Picture(_upright(values / factors, match), bayer_pattern="")


def _header(content: bytes) -> tuple[list[str], int]:
    """Return the lines of the header, and where the line with the size begins."""
    end = content.find(b"\n\n")
    if not content.startswith(b"#?") or end < 0:
        raise UnreadablePictureError("is no Radiance picture, or damaged: it does not begin with #? and a header")
    return content[:end].decode("latin-1").splitlines()[1:], end + 2


def _factors(lines: list[str]) -> NDArray[np.float32]:
    """Return by what red, green and blue have been multiplied since they were radiance; several lines add up."""
    factors = np.ones(3)
    for key, _, value in (line.partition("=") for line in lines):
        match key.strip():
            case "FORMAT" if value.strip() != "32-bit_rle_rgbe":
                raise UnreadablePictureError(f"has colours of the format {value.strip()}; save it as 32-bit_rle_rgbe")
            case "EXPOSURE" | "COLORCORR":
                factors *= _numbers(key.strip(), value)
            case "GAMMA" if not np.all(_numbers("GAMMA", value) == 1.0):
                raise UnreadablePictureError(f"states GAMMA={value.strip()}; save it with linear values")
    return factors.astype(np.float32)


def _numbers(key: str, value: str) -> NDArray[np.float64]:
    try:
        numbers = np.array([float(part) for part in value.split()])
    except ValueError:
        numbers = np.zeros(0)
    if numbers.size not in (1, 3) or not (np.isfinite(numbers) & (numbers > 0)).all():
        raise UnreadablePictureError(f"states {key}={value.strip()}; needed are positive numbers")
    return numbers


def _decoded(content: bytes, position: int, n_lines: int, length: int) -> NDArray[np.uint8]:
    """Return mantissas and exponents as stored, shape (n_lines, length, 4)."""
    lines = np.empty((n_lines, length, 4), np.uint8)
    try:
        for line in lines:
            mark = content[position : position + 4]
            in_planes = mark[:2] == b"\2\2" and mark[2] < _RUN and 8 <= length < 1 << 15
            if in_planes and int.from_bytes(mark[2:]) != length:
                raise UnreadablePictureError("is damaged: its lines differ in length")
            decode = _planes if in_planes else _pixels
            position = decode(content, position + 4 * in_planes, line)
    except (IndexError, ValueError):
        raise UnreadablePictureError("is damaged or cut short") from None
    return lines


def _planes(content: bytes, position: int, line: NDArray[np.uint8]) -> int:
    """Fill `line`, whose four parts are stored one after the other, in runs; return where the next one begins."""
    length = len(line)
    for part in range(4):
        values = bytearray()
        while len(values) < length:
            count = content[position]
            if count > _RUN:
                values += content[position + 1 : position + 2] * (count - _RUN)
                position += 2
            elif count:
                values += content[position + 1 : position + 1 + count]
                position += 1 + count
            else:
                raise UnreadablePictureError("is damaged: a run of no length")
        line[:, part] = np.frombuffer(values, np.uint8)  # of another length: damaged
    return position


def _pixels(content: bytes, position: int, line: NDArray[np.uint8]) -> int:
    """Fill `line`, which is stored pixel by pixel, 1 1 1 n for n times the one before; return where the next begins."""
    length = len(line)
    plain = (
        np.frombuffer(content, np.uint8, 4 * length, position).reshape(-1, 4)
        if _holds(content, position, length)
        else None
    )
    if plain is not None and not (plain[:, :3] == 1).all(axis=1).any():
        line[:] = plain
        return position + 4 * length
    done, shift = 0, 0
    while done < length:
        pixel = np.frombuffer(content, np.uint8, 4, position)
        position += 4
        repeated = (pixel[:3] == 1).all()
        n = int(pixel[3]) << shift if repeated else 1
        if done + n > length or (repeated and not done):
            raise UnreadablePictureError("is damaged: a run that is too long")
        line[done : done + n] = line[done - 1] if repeated else pixel
        done, shift = done + n, shift + 8 if repeated else 0
    return position


def _holds(content: bytes, position: int, length: int) -> bool:
    return len(content) >= position + 4 * length


def _upright(values: NDArray[Any], match: re.Match[bytes]) -> NDArray[Any]:
    """Turn what is stored line by line so that rows run down and columns to the right: ``-Y 4 +X 3`` is so already."""
    if match[1] != (b"-" if match[2] == b"Y" else b"+"):
        values = values[::-1]
    if match[4] != (b"+" if match[5] == b"X" else b"-"):
        values = values[:, ::-1]
    return values if match[2] == b"Y" else np.swapaxes(values, 0, 1)
