"""Writes files of kinds that no library here writes with all that they may hold; each knows its format on its own."""

from __future__ import annotations

import zlib
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
    """Write counts, shape (height, width, channels), side by side in two strips or more; each row ends with its byte.

    `options` are planar, order, photometric, more (tags), extra (what more samples than colours are).
    """
    strips = [_side_by_side(rows, bits) for rows in _strips(counts, options.get("planar", False))]
    tiff_by_hand(path, counts.shape, strips, bits, **options)
    with tifffile.TiffFile(path) as file:
        assert file.pages.first.bitspersample == bits


def compressed_tiff(path: Path, values: NDArray[Any], how: str, **options: Any) -> None:
    """Write values, shape (height, width, channels), in strips, compressed: "none", "packbits", "lzw", "deflate".

    `options` are those of `packed_tiff`, and difference (along a row, predictor 2), reverse (bits of a byte).
    """
    difference, order = options.get("difference", False), options.get("order", "<")
    compress = {"none": bytes, "packbits": _packbits, "lzw": _lzw, "deflate": zlib.compress}[how]
    strips = []
    for rows in _strips(values, options.get("planar", False)):
        samples = rows.reshape(len(rows), values.shape[1], -1)
        if difference:
            samples = np.diff(samples, axis=1, prepend=np.zeros_like(samples[:, :1]))
        strips.append(compress(samples.astype(samples.dtype.newbyteorder(order)).tobytes()))
    if options.get("reverse", False):
        strips = [bytes(int(f"{byte:08b}"[::-1], 2) for byte in strip) for strip in strips]
    formats = {"u": 1, "i": 2, "f": 3}
    more = [
        (259, "H", [{"none": 1, "lzw": 5, "deflate": 8, "packbits": 32773}[how]]),
        (266, "H", [2 if options.get("reverse", False) else 1]),
        (317, "H", [2 if difference else 1]),
        (339, "H", [formats[values.dtype.kind]] * values.shape[2]),
        *options.get("more", ()),
    ]
    tiff_by_hand(path, values.shape, strips, 8 * values.dtype.itemsize, **options | {"more": more})


def tiff_by_hand(path: Path, shape: tuple[int, ...], strips: list[bytes], bits: int, **options: Any) -> None:
    """Write a TIFF file of one page; `options` as in `packed_tiff`."""
    height, width, channels = shape
    starts = np.cumsum([8, *map(len, strips)])
    tags: dict[int, tuple[str, Sequence[int]]] = {
        256: ("H", [width]),
        257: ("H", [height]),
        258: ("H", [bits] * channels),
        259: ("H", [1]),
        262: ("H", [options.get("photometric", 2 if channels == 3 else 1)]),
        273: ("I", starts[:-1].tolist()),
        277: ("H", [channels]),
        278: ("H", [(height + 1) // 2]),
        279: ("I", [len(strip) for strip in strips]),
        284: ("H", [2 if options.get("planar", False) else 1]),
    }
    if "extra" in options:
        tags[338] = ("H", [options["extra"]])
    tags |= {code: (kind, values) for code, kind, values in options.get("more", ())}
    order = options.get("order", "<")
    directory, beyond = b"", b""
    after = int(starts[-1]) + 2 + 12 * len(tags) + 4
    for code, (kind, values) in sorted(tags.items()):
        data = pack(f"{order}{len(values)}{kind}", *values)
        if len(data) > 4:
            field = pack(f"{order}I", after + len(beyond))
            beyond += data
        else:
            field = data.ljust(4, b"\0")
        directory += pack(f"{order}HHI", code, {"B": 1, "H": 3, "I": 4}[kind], len(values)) + field
    head = (b"II" if order == "<" else b"MM") + pack(f"{order}HI", 42, int(starts[-1]))
    body = pack(f"{order}H", len(tags)) + directory + pack(f"{order}I", 0) + beyond
    path.write_bytes(head + b"".join(strips) + body)


def _strips(values: NDArray[Any], planar: bool) -> list[NDArray[Any]]:
    """Return the upper and lower half of a picture, or of each of its planes, as rows of values."""
    height = len(values)
    planes = np.moveaxis(values, 2, 0) if planar else values.reshape(1, height, -1)
    half = (height + 1) // 2
    return [rows for plane in planes for rows in (plane[:half], plane[half:]) if len(rows)]


def _side_by_side(rows: NDArray[np.uint16], bits: int) -> bytes:
    each = (rows[..., None] >> np.arange(bits - 1, -1, -1, dtype=np.uint16)) & 1
    return np.packbits(each.reshape(len(rows), -1).astype(np.uint8), axis=1).tobytes()


def _packbits(data: bytes) -> bytes:
    """Return bytes as they are, in literal runs, after one run of the same."""
    n = 1
    while n < min(len(data), 128) and data[n] == data[0]:
        n += 1
    out = bytes([257 - n, data[0]]) if n > 1 else b""
    rest = data[n:] if n > 1 else data
    return out + b"".join(bytes([len(rest[i : i + 128]) - 1]) + rest[i : i + 128] for i in range(0, len(rest), 128))


def _lzw(data: bytes) -> bytes:
    """Return TIFF's LZW of bytes, section 13 of TIFF 6.0."""
    codes: list[tuple[int, int]] = []
    table: dict[bytes, int] = {}
    width, known = 9, b""

    def clear() -> None:
        nonlocal table, width
        codes.append((256, width))
        table, width = {bytes([i]): i for i in range(256)}, 9

    clear()
    for i in range(len(data)):
        byte = data[i : i + 1]
        if known + byte in table:
            known += byte
            continue
        codes.append((table[known], width))
        table[known + byte] = len(table) + 2
        known = byte
        # One code early, as everybody does.
        width = max(9, (len(table) + 2).bit_length())
        if len(table) + 2 == 4094:
            clear()
    codes += [(table[known], width), (257, max(width, (len(table) + 3).bit_length()))]
    bits = "".join(f"{code:0{n}b}" for code, n in codes)
    bits += "0" * (-len(bits) % 8)
    return int(bits, 2).to_bytes(len(bits) // 8)
