"""Writes files of kinds that no library here writes with all that they may hold; each knows its format on its own."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from struct import pack
from typing import Any

import numpy as np
import tifffile
from numpy.typing import NDArray


def write_hdr(
    path: Path, light: NDArray[Any], lines: Sequence[str] = (), how: str = "runs", size: str = "-Y +X"
) -> None:
    """Write a Radiance picture; `how` is "runs", "old runs" or "flat", `size` how its lines run."""
    stored = rgbe(light)
    first, second = size.split()
    # Lines along y unless the first letter is X; then the picture is written column by column.
    stored = stored if first[1] == "Y" else np.swapaxes(stored, 0, 1)
    stored = stored[::-1] if first in ("+Y", "-X") else stored
    stored = stored[:, ::-1] if second in ("+Y", "-X") else stored
    stored = np.ascontiguousarray(stored)
    format_line = [] if any(line.startswith("FORMAT") for line in lines) else ["FORMAT=32-bit_rle_rgbe"]
    header = "\n".join(
        ["#?RADIANCE", *format_line, *lines, "", f"{first} {len(stored)} {second} {stored.shape[1]}", ""]
    )
    write_line = {"runs": _planes, "old runs": _old_runs, "flat": lambda line: line.tobytes()}[how]
    path.write_bytes(header.encode() + b"".join(map(write_line, stored)))


def rgbe(light: NDArray[Any]) -> NDArray[np.uint8]:
    """Return three mantissas, cut off, and their exponent."""
    largest = light.max(axis=2)
    exponent = np.where(largest > 0, np.frexp(np.where(largest > 0, largest, 1.0))[1], -128)
    mantissas = np.floor(np.ldexp(light.astype(np.float64), (8 - exponent)[..., None]))
    return np.concatenate([mantissas, (exponent + 128)[..., None]], axis=2).astype(np.uint8)


def _planes(line: NDArray[np.uint8]) -> bytes:
    return b"\2\2" + pack(">H", len(line)) + b"".join(_runs(plane.tobytes()) for plane in line.T)


def _runs(values: bytes) -> bytes:
    out, i = b"", 0
    while i < len(values):
        n = 1
        while n < 127 and i + n < len(values) and values[i + n] == values[i]:
            n += 1
        if n > 2:
            out += bytes([128 + n, values[i]])
        else:
            n = min(2, len(values) - i)
            out += bytes([n]) + values[i : i + n]
        i += n
    return out


def _old_runs(line: NDArray[np.uint8]) -> bytes:
    out, i = b"", 0
    while i < len(line):
        n = 1
        while i + n < len(line) and (line[i + n] == line[i]).all():
            n += 1
        out += line[i].tobytes()
        repeats, digits = n - 1, b""
        while repeats:
            digits += bytes([1, 1, 1, repeats & 255])
            repeats >>= 8
        out += digits
        i += n
    return out


def write_pfm(path: Path, light: NDArray[Any], order: str = "<", scale: float = 1.0) -> None:
    """Write a portable float map, its bottom row first."""
    kind = "PF" if light.ndim == 3 else "Pf"
    header = f"{kind}\n{light.shape[1]} {light.shape[0]}\n{-scale if order == '<' else scale}\n"
    path.write_bytes(header.encode() + light[::-1].astype(f"{order}f4").tobytes())


def write_bmp(path: Path, pixels: NDArray[np.uint8], bits: int = 24, **options: Any) -> None:
    """Write a bitmap of red, green and blue; of fewer than 24 bits one of what is no picture."""
    height, width = pixels.shape[:2]
    masks = options.get("masks")
    compression = options.get("compression", 3 if masks else 0)
    table = b"" if masks is None else pack("<III", *masks)
    if bits <= 8:
        table = bytes(4 << bits)
    stride = (width * bits + 31) // 32 * 4
    rows = np.zeros((height, stride), np.uint8)
    if bits >= 24:
        each = np.full((height, width, bits // 8), options.get("fourth", 0), np.uint8)
        each[..., :3] = pixels[..., ::-1]
        rows[:, : width * bits // 8] = each.reshape(height, -1)
    from_top = options.get("from_top", False)
    data = (rows if from_top else rows[::-1]).tobytes()
    info = pack("<IiiHHIIiiII", 40, width, -height if from_top else height, 1, bits, compression, len(data), 0, 0, 0, 0)
    start = 14 + len(info) + len(table)
    path.write_bytes(b"BM" + pack("<IHHI", start + len(data), 0, 0, start) + info + table + data)


def packed_tiff(path: Path, counts: NDArray[np.uint16], bits: int, **options: Any) -> None:
    """Write counts, shape (height, width, 1 or 3), side by side in two strips; each row ends with its byte."""
    height, width, channels = counts.shape
    planar = options.get("planar", False)
    planes = np.moveaxis(counts, 2, 0) if planar else counts.reshape(1, height, -1)
    halves = [half for plane in planes for half in (plane[: height // 2], plane[height // 2 :])]
    order = options.get("order", "<")
    strips = [_side_by_side(half, bits) for half in halves]
    starts = np.cumsum([8, *map(len, strips)])
    entries: list[tuple[int, str, Sequence[int]]] = [
        (256, "H", [width]),
        (257, "H", [height]),
        (258, "H", [bits] * channels),
        (259, "H", [1]),
        (262, "H", [options.get("photometric", 2 if channels == 3 else 1)]),
        (273, "I", starts[:-1].tolist()),
        (277, "H", [channels]),
        (278, "H", [height // 2 if height % 2 == 0 else height // 2 + 1]),
        (279, "I", [len(strip) for strip in strips]),
        (284, "H", [2 if planar else 1]),
    ]
    directory, beyond = b"", b""
    after = int(starts[-1]) + 2 + 12 * len(entries) + 4
    for code, kind, values in entries:
        data = pack(f"{order}{len(values)}{kind}", *values)
        if len(data) > 4:
            field = pack(f"{order}I", after + len(beyond))
            beyond += data
        else:
            field = data.ljust(4, b"\0")
        directory += pack(f"{order}HHI", code, {"H": 3, "I": 4}[kind], len(values)) + field
    head = (b"II" if order == "<" else b"MM") + pack(f"{order}HI", 42, int(starts[-1]))
    body = pack(f"{order}H", len(entries)) + directory + pack(f"{order}I", 0) + beyond
    path.write_bytes(head + b"".join(strips) + body)
    with tifffile.TiffFile(path) as file:
        assert file.pages.first.bitspersample == bits


def _side_by_side(rows: NDArray[np.uint16], bits: int) -> bytes:
    each = (rows[..., None] >> np.arange(bits - 1, -1, -1, dtype=np.uint16)) & 1
    return np.packbits(each.reshape(len(rows), -1).astype(np.uint8), axis=1).tobytes()
