"""OpenEXR files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import OpenEXR

from tests.instrument.pictures.made.made import Chooser, Made

LOSSLESS = (
    OpenEXR.ZIP_COMPRESSION,
    OpenEXR.NO_COMPRESSION,
    OpenEXR.RLE_COMPRESSION,
    OpenEXR.ZIPS_COMPRESSION,
    OpenEXR.PIZ_COMPRESSION,
)


def make_exr(path: Path, choose: Chooser) -> Made:
    """Make a file."""
    path = path.with_suffix(".exr")
    dtype = np.dtype(choose.one("dtype", ["f4", "f2", "u4"], 0.4))
    names = choose.one("channels", ["RGB", "Y", "RGBA", "YA", "RG", "layer.RGB", "Y RY BY", "RGBZ", "mixed"], 0.3)
    height, width = choose.size()
    values = choose.values(dtype, (height, width, 3 if "RG" in names or names == "mixed" else 1))
    channels, opaque = _channels(choose, names, values)
    header: dict[str, Any] = {
        "type": choose.one("type", [OpenEXR.scanlineimage, OpenEXR.tiledimage]),
        "compression": choose.one("compression", LOSSLESS),
        "lineOrder": choose.one("line order", [OpenEXR.INCREASING_Y, OpenEXR.DECREASING_Y]),
    }
    if header["type"] == OpenEXR.tiledimage:
        header["tiles"] = OpenEXR.TileDescription()
        header["lineOrder"] = OpenEXR.INCREASING_Y
    if choose.yes("chromaticities", 0.3):
        header["chromaticities"] = (0.7, 0.3, 0.17, 0.79, 0.13, 0.04, 0.31, 0.33)
    windows = choose.one("windows", ["equal", "cropped", "moved", "overscan"], 0.7)
    _set_windows(header, windows, height, width)
    parts = choose.one("parts", ["one", "two", "depth"], 0.8)
    _write(path, header, channels, parts)
    plain = names in ("RGB", "Y", "RGBZ", "mixed") or (names in ("RGBA", "YA") and opaque)
    must = dtype.kind == "f" and plain and windows in ("equal", "moved") and parts != "two"
    has_light = opaque and windows in ("equal", "moved") and names not in ("RG", "Y RY BY", "layer.RGB")
    return Made(path, choose.header, values if has_light else None, must_read=must and windows == "equal")


def _channels(choose: Chooser, names: str, values: Any) -> tuple[dict[str, Any], bool]:
    first = np.ascontiguousarray(values[..., 0])
    alpha = np.ones_like(first)
    opaque = not names.endswith("A") or choose.yes("opaque", 0.5)
    if not opaque:
        alpha[0, 0] = 0
    each = dict(zip("RGB", (np.ascontiguousarray(plane) for plane in np.moveaxis(values, -1, 0)), strict=False))
    channels: dict[str, Any] = {
        "RGB": each,
        "RGBA": each | {"A": alpha},
        "RGBZ": each | {"Z": first},
        "Y": {"Y": first},
        "YA": {"Y": first, "A": alpha},
        "Y RY BY": {"Y": first, "RY": first, "BY": first},
        "RG": {"R": first, "G": first},
        "layer.RGB": {f"layer.{name}": plane for name, plane in each.items()},
        "mixed": each | {"G": each.get("G", first).astype(np.float32)},
    }[names]
    return channels, opaque


def _set_windows(header: dict[str, Any], windows: str, height: int, width: int) -> None:
    y, x = {"equal": (0, 0), "cropped": (2, 3), "moved": (5, 4), "overscan": (-1, -1)}[windows]
    header["dataWindow"] = ((x, y), (x + width - 1, y + height - 1))
    shown = {"cropped": ((0, 0), (width + 5, height + 5)), "overscan": ((0, 0), (width - 2, height - 2))}
    header["displayWindow"] = shown.get(windows, header["dataWindow"])


def _write(path: Path, header: dict[str, Any], channels: dict[str, Any], parts: str) -> None:
    if parts == "one":
        with OpenEXR.File(header, channels) as file:
            file.write(str(path))
        return
    first = next(iter(channels.values()))
    other = {"Z": first} if parts == "depth" else channels
    all_parts = [OpenEXR.Part(header | {"name": "other"}, other), OpenEXR.Part(header | {"name": "picture"}, channels)]
    with OpenEXR.File(all_parts) as file:
        file.write(str(path))
