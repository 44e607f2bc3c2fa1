"""DNG files of mosaics and of linear values."""

from __future__ import annotations

from pathlib import Path
from struct import pack
from typing import Any

import numpy as np
import tifffile

from tests.instrument.pictures.made.made import Array, Chooser, Made
from tests.instrument.pictures.writers import packed_tiff

IDENTITY = tuple(part for value in np.eye(3, dtype=int).ravel() for part in (int(value), 1))
BAYER = {"RGGB": b"\0\1\1\2", "BGGR": b"\2\1\1\0", "GRBG": b"\1\0\2\1", "GBRG": b"\1\2\0\1"}
HARMLESS, MAPPING = 9, 8
_OF_THE_FILE = (274, 50706, 50707, 50708, 50721, 50728, 50730)


def make_dng(path: Path, choose: Chooser) -> Made:
    """Make a file."""
    path = path.with_suffix(".dng")
    if choose.yes("packed", 0.1):
        return _packed(path, choose)
    linear = choose.yes("linear", 0.25)
    n = choose.one("channels", [3, 1], 0.7) if linear else 1
    dtype = np.dtype(choose.one("dtype", ["u2", "u1", "f4", "i2"], 0.85))
    height, width = choose.size(34, 48)
    tags: list[Any] = _common(choose, dtype)
    must = dtype.kind == "u" and choose.header["orientation"] != 2
    top, left, bottom, right = area = _area(choose, height, width)
    tags.append((50829, "I", 4, area, True))
    black, black_tags, handed_on = _black(choose, linear, n)
    white = int(choose.one("white", [200 if dtype.itemsize == 1 else 4095, 250 if dtype.itemsize == 1 else 16000]))
    silent = choose.yes("no white", 0.1)
    tags += [*black_tags, *([] if silent else [(50717, "I", n, (white,) * n if n > 1 else white, True)])]
    stored = choose.rng.integers(0, white + 1, (height, width, n)).astype(dtype)
    light: Array | None = stored.astype(np.float64)
    table = None if dtype.kind != "u" else choose.one("table", [None, "square"], 0.85)
    if table:
        curve = np.round(np.linspace(0, 1, white + 1) ** 2 * white).astype(np.uint16)
        tags.append((50712, "H", len(curve), tuple(curve.tolist()), True))
        light = curve[stored].astype(np.float64)
    light, delta_tags = _deltas(choose, light, area)
    opcode = choose.one("opcode", [None, HARMLESS, MAPPING], 0.8)
    if opcode:
        content = pack(">I", 1) + pack(">IIII", opcode, 0x01030000, 1, 8) + bytes(8)
        tags.append((choose.one("list", [51008, 51009, 51022]), "B", len(content), content, True))
        light = None if opcode == MAPPING else light
    pattern = "" if linear else choose.one("pattern", [*BAYER, *BAYER, "X-Trans", "RGBW"])
    tags += _mosaic(pattern)
    if pattern in ("X-Trans", "RGBW"):
        light, must = None, False
    must = must and handed_on and not table and not delta_tags and light is not None
    named = path.with_suffix(".tif") if choose.yes("named .tif", 0.1) else path
    preview = choose.yes("preview first", 0.3)
    _write(named, stored, tags + delta_tags, linear, choose, preview and not (linear and n == 1))
    if silent:
        white = 256**dtype.itemsize - 1
    inside = None if light is None else light[top:bottom, left:right]
    return Made(named, choose.header, inside, 1e-6, must, black=black, white=float(white), pattern=pattern)


def _packed(path: Path, choose: Chooser) -> Made:
    """Make a file of a mosaic whose values of 10, 12 or 14 bits stand side by side."""
    bits = choose.one("bits", [10, 12, 14])
    height, width = choose.size(34, 48)
    counts = choose.rng.integers(0, 1 << bits, (height // 2 * 2, width, 1)).astype(np.uint16)
    pattern = choose.one("pattern", list(BAYER))
    cell = choose.rng.integers(0, 60, 4).tolist()
    more = [
        (50706, "B", [1, 4, 0, 0]),
        (33421, "H", [2, 2]),
        (33422, "B", list(BAYER[pattern])),
        (50713, "H", [2, 2]),
        (50714, "I", cell),
        (50829, "I", [0, 0, *counts.shape[:2]]),
        (50717, "I", [white := (1 << bits) - 1]),
    ]
    packed_tiff(path, counts, bits, photometric=32803, order=choose.one("order", "<>"), more=more)
    black = np.reshape(cell, (2, 2)).astype(float)
    return Made(path, choose.header, counts, black=black, white=float(white), pattern=pattern)


def _common(choose: Chooser, dtype: Any) -> list[Any]:
    tags: list[Any] = [
        (50706, "B", 4, b"\1\4\0\0", True),
        (50707, "B", 4, b"\1\1\0\0", True),
        (50708, "s", 0, "acme pocket", True),
        (50721, "2i", 9, IDENTITY, True),
    ]
    if choose.yes("neutral", 0.5):
        tags.append((50728, "2I", 3, (1, 2, 1, 1, 2, 3), True))
    if choose.yes("default crop", 0.3):
        tags += [(50719, "2I", 2, (2, 1, 3, 1), True), (50720, "2I", 2, (24, 1, 22, 1), True)]
    if choose.yes("baseline exposure", 0.3):
        tags.append((50730, "2i", 1, (3, 2), True))
    if orientation := choose.one("orientation", [None, 1, 3, 6, 8, 2], 0.6):
        tags.append((274, "H", 1, orientation, True))
    return tags


def _area(choose: Chooser, height: int, width: int) -> tuple[int, int, int, int]:
    if not choose.yes("active area", 0.4):
        return 0, 0, height, width
    top, left, bottom, right = (int(n) for n in choose.rng.integers(0, 5, 4))
    choose.header["area"] = (top, left, height - bottom, width - right)
    return top, left, height - bottom, width - right


def _black(choose: Chooser, linear: bool, n: int) -> tuple[Array, list[Any], bool]:
    """Return the levels of the cell (or of the channels), their tags, and whether LibRaw hands them on."""
    kind = choose.one("black", ["cell", "one", "none", "each", "large"])
    fraction = choose.yes("fractions of black", 0.3)
    rng = choose.rng

    def tag(levels: Array) -> tuple[Any, ...]:
        if not fraction:
            return 50714, "I", levels.size, tuple(int(v) for v in levels) if levels.size > 1 else int(levels[0]), True
        return 50714, "2I", levels.size, tuple(part for v in levels for part in (round(v * 100), 100)), True

    def levels(size: int) -> Array:
        return np.asarray(np.round(rng.uniform(20, 60, size), 2) if fraction else rng.integers(20, 60, size), float)

    if kind == "none":
        return np.zeros((2, 2)), [], True
    if kind == "large":
        size = [(50713, "H", 2, (4, 2), True)]
        return np.full((2, 2), np.nan), [*size, tag(np.tile(levels(8), n))], False
    if linear:
        each = np.tile(levels(1), n) if kind != "each" else levels(n)
        return np.full((2, 2), each[0]), [tag(each)], n == 1 or kind != "each"
    if kind == "one":
        one = levels(1)
        return np.full((2, 2), one[0]), [tag(one)], True
    cell = levels(4)
    return cell.reshape(2, 2), [(50713, "H", 2, (2, 2), True), tag(cell)], True


def _deltas(choose: Chooser, light: Array, area: tuple[int, int, int, int]) -> tuple[Array, list[Any]]:
    """Return the light without the black levels of rows or columns, and their tags."""
    axis = choose.one("delta", [None, 0, 1], 0.9)
    if axis is None:
        return light, []
    first, size = area[axis], area[axis + 2] - area[axis]
    delta = choose.rng.integers(0, 9, size)
    out = light.copy()
    index = [slice(None)] * 3
    index[axis] = slice(first, first + size)
    out[tuple(index)] -= delta.reshape((-1, 1, 1) if axis == 0 else (1, -1, 1))
    # Across is one for each column, down one for each row.
    code = 50716 if axis == 0 else 50715
    return out, [(code, "2i", size, tuple(part for v in delta for part in (int(v), 1)), True)]


def _mosaic(pattern: str) -> list[Any]:
    if not pattern:
        return []
    if pattern == "X-Trans":
        cell = np.frombuffer(b"\1\0\1\1\2\1\2\1\2\0\1\0\1\0\1\1\2\1\1\2\1\1\0\1\0\1\0\2\1\2\1\2\1\1\0\1", np.uint8)
        return [(33421, "H", 2, (6, 6), True), (33422, "B", 36, cell.tobytes(), True)]
    return [(33421, "H", 2, (2, 2), True), (33422, "B", 4, BAYER.get(pattern, b"\0\1\1\1"), True)]


def _write(path: Path, stored: Array, tags: list[Any], linear: bool, choose: Chooser, preview: bool) -> None:
    n = stored.shape[2]
    pixels = stored if n > 1 else stored[..., 0]
    options: dict[str, Any] = {"extratags": tags, "metadata": None}
    options |= {"planarconfig": "contig"} if n > 1 else {}
    photometric = "minisblack" if linear and n == 1 else 34892 if linear else 32803
    with tifffile.TiffWriter(path, byteorder=choose.one("order", "<>")) as file:
        if preview:
            common = [tag for tag in tags if tag[0] in _OF_THE_FILE]
            options["extratags"] = [tag for tag in tags if tag[0] not in _OF_THE_FILE]
            small = np.zeros((8, 8, 3), np.uint8)
            file.write(small, photometric="rgb", subfiletype=1, subifds=1, extratags=common, metadata=None)
        file.write(pixels, photometric=photometric, **options)
    if linear and n == 1:
        # DNG allows one sample, which the writer does not.
        with path.open("r+b") as file, tifffile.TiffFile(file) as tiff:
            tiff.pages.first.tags[262].overwrite(34892)
