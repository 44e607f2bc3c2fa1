"""TIFF files by four writers: tifffile, Pillow's libtiff, OpenCV's, and by hand what none of them writes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import tifffile
from PIL import Image

from tests.instrument.pictures.made.made import Array, Chooser, Made, icc_profile
from tests.instrument.pictures.writers import compressed_tiff, packed_tiff

UPRIGHT_OR_TURNED = (1, 3, 6, 8)
READABLE = ("u1", "u2", "f2", "f4", "f8")

_NUMBERS = {"miniswhite": 0, "minisblack": 1, "rgb": 2, "palette": 3, "separated": 5, "ycbcr": 6}


def make_tiff(path: Path, choose: Chooser) -> Made:
    """Make a file by one of the writers."""
    writer = choose.one("writer", [_by_tifffile, _by_tifffile, _by_pillow, _by_opencv, _by_hand, _by_hand, _packed])
    choose.header["writer"] = writer.__name__
    made: Made = writer(path.with_suffix(".tif"), choose)
    return made


def _by_tifffile(path: Path, choose: Chooser) -> Made:
    kind = choose.one(
        "photometric", ["minisblack", "rgb", "miniswhite", "palette", "separated", "cielab", "ycbcr"], 0.4
    )
    dtype = np.dtype(choose.one("dtype", [*READABLE, "i1", "i2", "i4", "u4", "u8", "c8"], 0.1))
    n = {"rgb": 3, "separated": 4, "cielab": 3, "ycbcr": 3}.get(kind, 1)
    if kind == "palette":
        dtype = np.dtype(choose.one("index", ["u1", "u2"]))
    extra = choose.one("extra", [(), ("assocalpha",), ("unassalpha",), ("unspecified",)], 0.7)
    extra = extra if kind in ("rgb", "minisblack") else ()
    height, width = choose.size()
    values = choose.values(dtype, (height, width, n + len(extra)))
    if extra and (opaque := choose.yes("opaque", 0.6)):
        values[..., -1] = np.iinfo(dtype).max if dtype.kind in "iu" else 1
    options: dict[str, Any] = {"photometric": kind, "extrasamples": extra or None}
    light: Array | None = values[..., :n]
    must = dtype.str[1:] in READABLE and kind in ("minisblack", "rgb") and (not extra or opaque)
    if kind == "miniswhite":
        light = np.iinfo(dtype).max - values if dtype.kind == "u" else None
        must = dtype.str[1:] in ("u1", "u2")
    elif kind == "palette":
        colours = choose.rng.integers(0, 65536, (3, 256**dtype.itemsize)).astype(np.uint16)
        options["colormap"] = colours
        light = np.moveaxis(colours[:, values[..., 0]], 0, -1)
    elif kind in ("separated", "cielab", "ycbcr") or (extra and not opaque) or dtype.kind == "c":
        light = None
    must, curve = _structure(choose, options, must, values)
    stored = _laid_out(choose, options, values)
    pages = choose.one("pages", [1, 1, 1, 1, 1, 1, 2])
    thumbnail = pages == 1 and choose.yes("smaller copy in a sub-IFD", 0.1)
    try:
        with tifffile.TiffWriter(path, byteorder=choose.one("order", "<>"), bigtiff=choose.yes("big", 0.2)) as file:
            for _ in range(pages):
                file.write(stored, metadata=None, subifds=int(thumbnail), **options)
            if thumbnail:
                file.write(np.zeros((2, 2), np.uint8), metadata=None, subfiletype=1)
    except Exception as error:
        # Not every choice goes with every other in this writer.
        choose.header["not written"] = str(error)
        return make_tiff(path, Chooser(choose.rng))
    step = 0.0 if light is None or dtype != np.float64 else np.abs(light) * 1e-7
    return Made(path, choose.header, light, step, must and pages == 1, curve)


def _structure(choose: Chooser, options: dict[str, Any], must: bool, values: Array) -> tuple[bool, bool]:
    """Choose what has nothing to do with the values; return whether the file must be read, and has a curve."""
    tags: list[Any] = []
    orientation = choose.one("orientation", [None, 1, 2, 3, 4, 5, 6, 7, 8], 0.6)
    if orientation:
        tags.append((274, "H", 1, orientation, True))
        must = must and orientation in UPRIGHT_OR_TURNED
    gamma = choose.one("profile", [None, 1.0, 2.2], 0.7)
    if gamma:
        options["iccprofile"] = icc_profile(gamma)
    transfer = gamma is None and values.dtype.str[1:] in ("u1", "u2") and choose.one("transfer", [0.0, 1.0, 2.0], 0.8)
    if transfer:
        size = 256**values.dtype.itemsize
        table = np.round(65535 * np.linspace(0, 1, size) ** transfer).astype(int)
        tags.append((301, "H", size, tuple(table.tolist()), True))
    if choose.yes("reduced", 0.05):
        options["subfiletype"] = 1
        must = False
    if choose.yes("resolution", 0.3):
        options["resolution"] = (72, 144)
    if choose.yes("tiled", 0.2):
        options["tile"] = (16, 16)
    else:
        options["rowsperstrip"] = choose.one("rowsperstrip", [None, 1, 3])
    options["compression"] = choose.one("compression", [None, "deflate", "lzma"], 0.5)
    if options["compression"]:
        options["predictor"] = choose.one("predictor", [False, True])
    options["extratags"] = tags
    return must, (gamma or 1.0) != 1.0 or (transfer or 1.0) != 1.0


def _laid_out(choose: Chooser, options: dict[str, Any], values: Array) -> Array:
    """Choose how samples of a pixel stand: alone, together, or plane by plane."""
    if values.shape[2] == 1:
        return values[..., 0]
    options["planarconfig"] = choose.one("planarconfig", ["contig", "separate"], 0.6)
    return np.ascontiguousarray(np.moveaxis(values, -1, 0)) if options["planarconfig"] == "separate" else values


def _by_pillow(path: Path, choose: Chooser) -> Made:
    mode, dtype, n = choose.one("mode", [("L", "u1", 1), ("RGB", "u1", 3), ("RGBA", "u1", 4), ("I;16", "u2", 1)], 0.1)
    height, width = choose.size()
    values = choose.values(dtype, (height, width, n))
    opaque = mode != "RGBA" or choose.yes("opaque", 0.5)
    if mode == "RGBA" and opaque:
        values[..., 3] = 255
    white = mode == "L" and choose.yes("white is 0", 0.3)
    tags: dict[int, Any] = {262: 0} if white else {}
    orientation = choose.one("orientation", [None, 2, 3, 6], 0.7)
    if orientation:
        tags[274] = orientation
    compression = choose.one("compression", ["tiff_lzw", "packbits", "tiff_adobe_deflate", None])
    image = Image.fromarray(values[..., 0] if n == 1 else values)
    image.save(path, compression=compression, tiffinfo=tags)
    light = values[..., :3] if n > 1 else values
    # Pillow itself turns values round where 0 is white.
    return Made(path, choose.header, light if opaque else None, must_read=opaque and not white and not orientation)


def _by_opencv(path: Path, choose: Chooser) -> Made:
    dtype = choose.one("dtype", ["u1", "u2", "f4", "f8"])
    n = choose.one("channels", [1, 3])
    values = choose.values(dtype, (*choose.size(), n))
    compression = choose.one("compression", [1, 5, 8, 32773])
    options = [cv2.IMWRITE_TIFF_COMPRESSION, compression]
    if compression in (5, 8):
        options += [cv2.IMWRITE_TIFF_PREDICTOR, choose.one("predictor", [1, 2]) if dtype[0] == "u" else 1]
    cv2.imwrite(str(path), np.ascontiguousarray(values[..., ::-1]), options)
    return Made(path, choose.header, values, np.abs(values) * 1e-7 if dtype == "f8" else 0.0)


def _by_hand(path: Path, choose: Chooser) -> Made:
    dtype = np.dtype(choose.one("dtype", ["u1", "u2", "f4", "f2", "f8", "u4", "i1", "i2", "i4"], 0.2))
    kind = choose.one("photometric", ["rgb", "minisblack", "miniswhite", "palette", "separated", "ycbcr"], 0.4)
    n = {"rgb": 3, "separated": 4, "ycbcr": 3}.get(kind, 1)
    extra = choose.one("extra", [None, 0, 1, 2], 0.6) if kind in ("rgb", "minisblack") else None
    values = choose.values(dtype, (*choose.size(4), n + (extra is not None)))
    opaque = extra is None or choose.yes("opaque", 0.6)
    if extra is not None and opaque:
        values[..., -1] = np.iinfo(dtype).max if dtype.kind in "iu" else 1
    how = choose.one("compression", ["none", "packbits", "lzw", "deflate"])
    options: dict[str, Any] = {"order": choose.one("order", "<>"), "photometric": _NUMBERS[kind]}
    options |= {} if extra is None else {"extra": extra}
    options["planar"] = values.shape[2] > 1 and choose.yes("planar", 0.3)
    options["difference"] = dtype.kind in "iu" and how in ("lzw", "deflate") and choose.yes("difference", 0.4)
    options["reverse"] = choose.yes("bits reversed", 0.1)
    orientation = choose.one("orientation", [None, 1, 2, 3, 6, 8], 0.7)
    options["more"] = [(274, "H", [orientation])] if orientation else []
    compressed_tiff(path, values, how, **options)
    light: Array | None = values[..., :n]
    if kind == "miniswhite":
        light = np.iinfo(dtype).max - values if dtype.kind == "u" else None
    elif kind not in ("rgb", "minisblack") or not opaque:
        light = None
    # Compression, turning and planes together are more than is asked for.
    must = dtype.str[1:] in ("u1", "u2", "f4") and kind in ("rgb", "minisblack") and opaque
    must = must and orientation in (None, 1) and not options["reverse"] and not (options["planar"] and how != "none")
    must = must and (how == "none" or extra is None)
    step = 0.0 if light is None or dtype != np.float64 else np.abs(light) * 1e-7
    return Made(path, choose.header, light, step, must)


def _packed(path: Path, choose: Chooser) -> Made:
    bits = int(choose.one("bits", [9, 10, 11, 12, 13, 14, 15]))
    n = choose.one("channels", [1, 3])
    height, width = choose.size(4)
    counts = choose.rng.integers(0, 1 << bits, (height // 2 * 2, width, n)).astype(np.uint16)
    white = n == 1 and choose.yes("white is 0", 0.3)
    options = {"planar": n == 3 and choose.yes("planar", 0.4), "order": choose.one("order", "<>")}
    photometric = 2 if n == 3 else int(not white)
    packed_tiff(path, counts, bits, photometric=photometric, **options)
    light = np.uint16((1 << bits) - 1) - counts if white else counts
    return Made(path, choose.header, light, white=float((1 << bits) - 1))
