"""PNG files by hand: every depth, kind of colour and chunk that says something of the values."""

from __future__ import annotations

import zlib
from pathlib import Path
from struct import pack

import numpy as np

from tests.instrument.pictures.made.made import Array, Chooser, Made, icc_profile

GREY, RGB, PALETTE, GREY_ALPHA, RGBA = 0, 2, 3, 4, 6
DEPTHS = {GREY: (8, 16, 1, 2, 4), RGB: (8, 16), PALETTE: (8, 1, 2, 4), GREY_ALPHA: (8, 16), RGBA: (8, 16)}
SAMPLES = {GREY: 1, RGB: 3, PALETTE: 1, GREY_ALPHA: 2, RGBA: 4}
ADAM7 = ((0, 8, 0, 8), (0, 8, 4, 8), (4, 8, 0, 4), (0, 4, 2, 4), (2, 4, 0, 2), (0, 2, 1, 2), (1, 2, 0, 1))


def make_png(path: Path, choose: Chooser) -> Made:
    """Make a file."""
    path = path.with_suffix(".png")
    kind = choose.one("kind", [GREY, RGB, PALETTE, GREY_ALPHA, RGBA])
    bits = choose.one("bits", DEPTHS[kind])
    height, width = choose.size()
    stored = choose.rng.integers(0, 1 << bits, (height, width, SAMPLES[kind])).astype(np.uint16)
    opaque = kind not in (GREY_ALPHA, RGBA) or choose.yes("opaque", 0.7)
    if kind in (GREY_ALPHA, RGBA) and opaque:
        stored[..., -1] = (1 << bits) - 1
    light = stored[..., : 3 if kind in (RGB, RGBA) else 1]
    if bits < 8 and kind == GREY:
        light = light * (255 // ((1 << bits) - 1))
    chunks, curve = _said(choose)
    if choose.yes("sBIT", 0.2):
        most = 8 if kind == PALETTE else bits
        chunks.append(
            (b"sBIT", bytes(choose.rng.integers(1, most + 1, 3 if kind == PALETTE else SAMPLES[kind]).tolist()))
        )
    if kind == PALETTE:
        palette = choose.rng.integers(0, 256, (1 << bits, 3)).astype(np.uint8)
        chunks.append((b"PLTE", palette.tobytes()))
        light = palette[stored[..., 0]]
    if kind in (GREY, RGB, PALETTE) and choose.yes("tRNS", 0.2):
        opaque = False
        # One colour that is in the picture, or the first of a palette.
        first = stored[0, 0].astype(">u2").tobytes()
        chunks.append((b"tRNS", bytes([0] * (int(stored[0, 0, 0]) + 1)) if kind == PALETTE else first))
    orientation = choose.one("orientation", [None, 1, 3, 4, 6], 0.8)
    if orientation:
        chunks.append((b"eXIf", b"II*\0\10\0\0\0\1\0" + pack("<HHII", 274, 3, 1, orientation) + bytes(4)))
    interlaced = choose.yes("interlaced", 0.3)
    rows = b"".join(_pass(stored, bits, *one) for one in ADAM7) if interlaced else _pass(stored, bits, 0, 1, 0, 1)
    head = pack(">IIBBBBB", width, height, bits, kind, 0, 0, interlaced)
    content = [(b"IHDR", head), *chunks, (b"IDAT", zlib.compress(rows)), (b"IEND", b"")]
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + b"".join(chunk(*part) for part in content))
    must = opaque and orientation != 4
    return Made(path, choose.header, light if opaque else None, must_read=must, curve=curve)


def _said(choose: Chooser) -> tuple[list[tuple[bytes, bytes]], bool]:
    """Return chunks that say what the values mean, and whether they say that these are not linear."""
    chunks = []
    said = choose.one("curve", [None, "gAMA 1", "gAMA 1/2.2", "sRGB", "iCCP", "cICP 8", "cICP 13"], 0.3)
    match said:
        case "gAMA 1":
            chunks.append((b"gAMA", pack(">I", 100_000)))
        case "gAMA 1/2.2":
            chunks.append((b"gAMA", pack(">I", 45_455)))
        case "sRGB":
            chunks.append((b"sRGB", b"\0"))
        case "iCCP":
            chunks.append((b"iCCP", b"x\0\0" + zlib.compress(icc_profile(2.2))))
        case "cICP 8" | "cICP 13":
            chunks.append((b"cICP", bytes([1, int(said.split()[1]), 0, 1])))
    if choose.yes("cHRM", 0.2):
        chunks.append((b"cHRM", pack(">8I", 31270, 32900, 64000, 33000, 30000, 60000, 15000, 6000)))
    return chunks, said in ("gAMA 1/2.2", "sRGB", "iCCP", "cICP 13")


def _pass(stored: Array, bits: int, top: int, down: int, left: int, across: int) -> bytes:
    """Return one pass over a picture; every row begins with the filter that does nothing."""
    part = stored[top::down, left::across]
    if part.size == 0:
        return b""
    rows = part.reshape(len(part), -1)
    if bits == 16:
        packed = [row.astype(">u2").tobytes() for row in rows]
    elif bits == 8:
        packed = [row.astype(np.uint8).tobytes() for row in rows]
    else:
        each = (rows[..., None] >> np.arange(bits - 1, -1, -1, dtype=np.uint16)) & 1
        packed = [np.packbits(row.astype(np.uint8).ravel()).tobytes() for row in each]
    return b"".join(b"\0" + row for row in packed)


def chunk(name: bytes, data: bytes) -> bytes:
    """Return one part of a PNG file."""
    return pack(">I", len(data)) + name + data + pack(">I", zlib.crc32(name + data))
