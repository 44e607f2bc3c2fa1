"""Reads the data of a page that relights, and shades it by formulas of our own as its shader should; no browser."""

from __future__ import annotations

import base64
import json
import re
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

GRAZING = 0.01


@dataclass(frozen=True)
class Page:
    """What a page holds: figures, and arrays of shape (rows, columns, planes)."""

    meta: dict[str, Any]
    arrays: dict[str, NDArray[Any]]


def read_page(path: Path) -> Page:
    text = path.read_text(encoding="utf-8")
    meta = json.loads(_script(text, "meta"))
    raw = np.frombuffer(zlib.decompress(base64.b64decode(_script(text, "data"))), np.uint8)
    arrays, at = {}, 0
    for entry in meta["arrays"]:
        kind, (rows, columns, planes) = np.dtype(entry["kind"]), entry["shape"]
        size = rows * columns * planes * kind.itemsize
        of_bytes = raw[at : at + size].reshape(planes, kind.itemsize, rows, columns)
        if entry["differences"]:
            of_bytes = np.cumsum(of_bytes, axis=-1, dtype=np.uint8)
        of_bytes = of_bytes.transpose(2, 3, 0, 1)
        arrays[entry["name"]] = np.ascontiguousarray(of_bytes).view(kind)[..., 0]
        at += size
    assert at == len(raw)
    return Page(meta, arrays)


def _script(text: str, name: str) -> str:
    found = re.search(rf'<script type="[^"]*" id="{name}">(.*?)</script>', text, re.DOTALL)
    assert found, name
    return found.group(1)


def picture(page: Page, camera: Array, light: Array) -> Array:
    """Shade the page, (height * width, 3); NaN where a pixel is a hole."""
    normals, points = _normals(page), _points(page)
    to_light, to_camera = light - points, camera - points
    d2 = np.sum(to_light**2, axis=1)
    omega_i = to_light / np.sqrt(d2)[:, None]
    omega_o = to_camera / np.linalg.norm(to_camera, axis=1)[:, None]
    h = omega_i + omega_o
    h /= np.linalg.norm(h, axis=1)[:, None]
    angles = {
        "h": np.clip(_dot(normals, h), GRAZING, 1.0),
        "d": np.clip(_dot(omega_i, h), 0.0, 1.0),
        "l": np.clip(_dot(normals, omega_i), GRAZING, 1.0),
        "v": np.clip(_dot(normals, omega_o), GRAZING, 1.0),
    }
    n_dot_l = _dot(normals, omega_i)
    lit = np.where((n_dot_l > 0.0) & (_dot(normals, omega_o) > 0.0), n_dot_l, 0.0)
    shaded = _brdf(page, angles) * (lit / d2)[:, None]
    solved = page.arrays["facts"][..., 0].ravel() > 0
    return np.where(solved[:, None], shaded, np.nan)


def _dot(a: Array, b: Array) -> Array:
    return np.asarray(np.sum(a * b, axis=1))


def _normals(page: Page) -> Array:
    o = page.arrays["normals"].reshape(-1, 2) / 32767.0 - 1.0
    z = 1.0 - np.abs(o).sum(axis=1)
    folded = (1.0 - np.abs(o[:, ::-1])) * np.where(o < 0.0, -1.0, 1.0)
    n = np.column_stack([np.where(z[:, None] < 0.0, folded, o), z])
    return np.asarray(n / np.linalg.norm(n, axis=1)[:, None])


def _points(page: Page) -> Array:
    meta, (low, high) = page.meta, page.meta["heights_mm"]
    row, column = np.divmod(np.arange(meta["width"] * meta["height"]), meta["width"])
    x = meta["first_mm"][0] + meta["spacing_mm"] * column
    y = meta["first_mm"][1] - meta["spacing_mm"] * row
    return np.column_stack([x, y, low + (high - low) * page.arrays["heights"].ravel() / 65535.0])


def _brdf(page: Page, angles: dict[str, Array]) -> Array:
    arrays = page.arrays
    pixel = np.repeat(np.arange(arrays["counts"].size), arrays["counts"].ravel())
    column = arrays["columns"].ravel().astype(np.int64)
    bits = arrays["weights"][0].copy()
    bits[:, 1:] += bits[:, :1]
    weight = bits.view(np.float16).astype(np.float64) * arrays["scales"].ravel()[column, None]
    total = np.zeros((arrays["counts"].size, 3))
    for k in np.unique(column):
        of_k = column == k
        part = {name: values[pixel[of_k]] for name, values in angles.items()}
        np.add.at(total, pixel[of_k], weight[of_k] * _column(page, int(k), part).reshape(np.count_nonzero(of_k), -1))
    return total


def _column(page: Page, k: int, q: dict[str, Array]) -> Array:
    model, layer, n_h, n_d = (int(x) for x in page.arrays["header"][0, k])
    p = page.arrays["parameters"][0, k].astype(np.float64)
    h, d, left, view = q["h"], q["d"], q["l"], q["v"]
    if model == 0:
        return _table(page, layer, n_h, n_d, h, d)
    simple = {
        1: np.ones_like(h), 2: h, 3: (1.0 - h) ** 5, 4: 1.0 - h, 5: 1.0 / np.sqrt(left * view), 6: 1.0 / (left * view),
    }  # fmt: skip
    if model in simple:
        return np.asarray(simple[model] / np.pi)
    if model == 7:
        return np.asarray(1.0 / (1.0 + np.exp((np.arccos(h) - p[0]) / p[1])) / np.pi)
    if model == 8:
        return _lobe(p[0], p[1], h, d, left, view)
    return _sgd(p, h, d, left, view) if model == 9 else _abc(p, h, d, left, view)


def _table(page: Page, layer: int, n_h: int, n_d: int, h: Array, d: Array) -> Array:
    tables = page.arrays["tables"].reshape(len(page.arrays["nodes"]) // 2, -1, *page.arrays["tables"].shape[1:])
    over_h, over_d = (page.arrays["nodes"][2 * layer + i, :n, 0].astype(np.float64) for i, n in ((0, n_h), (1, n_d)))
    u = np.interp(np.sqrt(1.0 - h), over_h, np.arange(n_h))
    v = np.interp(np.arccos(d), over_d, np.arange(n_d))
    i, j = np.floor(u).astype(int), np.floor(v).astype(int)
    i2, j2 = np.minimum(i + 1, n_h - 1), np.minimum(j + 1, n_d - 1)
    a, b = (u - i)[:, None], (v - j)[:, None]
    t = tables[layer].astype(np.float64)
    return np.asarray((1 - a) * ((1 - b) * t[j, i] + b * t[j2, i]) + a * ((1 - b) * t[j, i2] + b * t[j2, i2]))


def _lobe(alpha: float, gamma: float, h: Array, d: Array, left: Array, view: Array) -> Array:
    def visibility(x: Array) -> Array:
        a2 = min(alpha, 1.0) ** 2
        return np.asarray(1.0 / (x + np.sqrt(a2 + (1.0 - a2) * x * x)))

    u = h**2 + (1.0 - h**2) / alpha**2
    fresnel = (0.04 + 0.96 * (1.0 - d) ** 5) / 0.04
    return np.asarray(u**-gamma * fresnel * visibility(left) * visibility(view) / visibility(h) ** 2)


def _sgd(p: Array, h: Array, d: Array, left: Array, view: Array) -> Array:
    rho_d, rho_s, alpha, power, f0, f1, log_kappa, lam, log_c, k, theta_0 = p[:11]
    ax = alpha + (1.0 / h**2 - 1.0) / alpha
    shape = np.exp(log_kappa - ax) * ax**-power / (np.pi * h**4)
    fresnel = f0 - f1 * d + (1.0 - f0) * (1.0 - d) ** 5
    for x in (left, view):
        with np.errstate(over="ignore"):
            grown = np.expm1(np.exp(log_c) * np.maximum(np.arccos(x) - theta_0, 0.0) ** k)
        shape = shape * np.clip(1.0 - lam * grown, 0.0, 1.0)
    return np.asarray((rho_d + rho_s * fresnel * shape / (left * view)) / np.pi)


def _abc(p: Array, h: Array, d: Array, left: Array, view: Array) -> Array:
    k_d, a, b, c, ior = p[:5]
    g = np.sqrt(np.maximum(ior**2 - 1.0 + d**2, 0.0))
    fresnel = 0.5 * (((d - g) / (d + g)) ** 2 + ((ior**2 * d - g) / (ior**2 * d + g)) ** 2)
    shadow = np.minimum(1.0, 2.0 * h * np.minimum(left, view) / np.maximum(d, GRAZING))
    return np.asarray((k_d + a * fresnel * (1.0 + b * (1.0 - h)) ** -c * shadow / (left * view)) / np.pi)
