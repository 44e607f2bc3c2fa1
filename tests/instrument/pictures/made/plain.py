"""Files of the plainer kinds: NumPy, Radiance, portable float maps and bitmaps."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from tests.instrument.pictures.made.made import Chooser, Made
from tests.instrument.pictures.writers import write_bmp, write_hdr, write_pfm

NUMPY = ["u1", "u2", "f2", "f4", "f8", "f16", "i1", "i2", "i4", "i8", "u4", "u8", "c8", "b1", "O", "M8[s]", "U3", "V"]


def make_npy(path: Path, choose: Chooser) -> Made:
    """Make an array of any type and order."""
    path = path.with_suffix(".npy")
    kind = NUMPY[int(choose.rng.integers(5))] if choose.yes("usual", 0.5) else choose.one("dtype", NUMPY)
    shape = choose.one("shape", [(), (3,), (1,), (2,), (4,), (3, 1)], 0.4)
    shape = (*choose.size(4), *shape)
    read = kind in NUMPY[:5]
    values: Any = choose.values(kind, shape) if kind[0] in "uifb" else np.zeros(shape, _no_number(kind))
    if kind == "c8":
        values = (choose.rng.normal(size=shape) + 1j).astype("c8")
    light = values if kind[0] in "uifb" else None
    stored = values.astype(values.dtype.newbyteorder(choose.one("order", "<>"))) if kind[0] in "uif" else values
    stored = np.asfortranarray(stored) if choose.yes("Fortran", 0.3) else stored
    np.save(path, stored, allow_pickle=True)
    fits = shape[2:] in ((), (1,), (3,))
    # In the shape that reading gives it.
    light = light if light is None or light.ndim == 3 else light[..., None]
    step = np.abs(light.astype(float)) * 1e-7 if kind in ("f8", "f16") and light is not None else 0.0
    return Made(path, choose.header, light if fits else None, step, must_read=read and fits)


def _no_number(kind: str) -> Any:
    return [("red", "u1"), ("green", "u1")] if kind == "V" else kind


def make_hdr(path: Path, choose: Chooser) -> Made:
    """Make a Radiance picture with exposures, corrections and lines in any direction."""
    path = path.with_suffix(".hdr")
    size = choose.size()
    values = choose.values("f4", (*size, 3)) * 10.0 ** choose.rng.integers(-6, 7)
    lines = []
    factors = np.ones(3)
    for _ in range(choose.one("exposures", [0, 0, 1, 2])):
        factors *= (exposure := round(float(choose.rng.uniform(0.1, 9)), 3))
        lines.append(f"EXPOSURE={exposure}")
    if choose.yes("COLORCORR", 0.2):
        lines.append("COLORCORR= 1.5 1.0 0.5")
        factors *= (1.5, 1.0, 0.5)
    other = choose.one(
        "other", ["", "FORMAT=32-bit_rle_xyze", "GAMMA=2.2", "GAMMA=1.0", "VIEW= -vtv", "PIXASPECT=2"], 0.5
    )
    lines += [other] if other else []
    directions = ["-Y +X", "+Y +X", "-Y -X", "+Y -X", "+X -Y", "+X +Y", "-X -Y", "-X +Y"]
    # Runs of each part of a colour are for lines of eight pixels or more.
    how = choose.one("how", ["old runs", "flat", "runs"][: 2 + (min(size) >= 8)])
    write_hdr(path, values * factors, lines, how, choose.one("directions", directions, 0.5))
    refused = other.startswith(("FORMAT", "GAMMA=2"))
    step = (values * factors).max(axis=2, keepdims=True) / 128 / factors
    return Made(path, choose.header, None if refused else values, step, must_read=not refused)


def make_pfm(path: Path, choose: Chooser) -> Made:
    """Make a portable float map."""
    path = path.with_suffix(".pfm")
    n = choose.one("channels", [1, 3])
    values = choose.values("f4", (*choose.size(), n))
    scale = choose.one("scale", [1.0, 0.5, 100.0], 0.7)
    write_pfm(path, values[..., 0] if n == 1 else values, choose.one("order", "<>"), scale)
    return Made(path, choose.header, values if scale == 1 else None, must_read=scale == 1)


def make_bmp(path: Path, choose: Chooser) -> Made:
    """Make a bitmap by hand, or by Pillow."""
    path = path.with_suffix(".bmp")
    height, width = choose.size()
    values = choose.values("u1", (height, width, 3))
    if choose.yes("by Pillow", 0.5):
        mode = choose.one("mode", ["L", "P", "1", "RGB"])
        image = Image.fromarray(values).convert(mode)
        image.save(path)
        return Made(path, choose.header, np.asarray(image.convert("L" if mode in "L1" else "RGB")))
    bits = choose.one("bits", [24, 32, 16, 8])
    fourth = choose.one("fourth", [0, 255, 7])
    usual = (0xFF0000, 0xFF00, 0xFF)
    masks = choose.one("masks", [None, usual, usual[::-1]], 0.5) if bits == 32 else None
    compression = 1 if bits == 8 else 3 if masks else 0
    write_bmp(
        path, values, bits, fourth=fourth, masks=masks, compression=compression, from_top=choose.yes("from top", 0.4)
    )
    seen = bits == 24 or (bits == 32 and fourth != 7 and masks in (None, usual))
    return Made(path, choose.header, values if seen else None, must_read=seen)
