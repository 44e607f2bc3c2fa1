"""Maps as textures: whole numbers by the conventions that other programs have, and back."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from analysis.export.maps import SurfaceMaps
from analysis.export.microfacet import MAX_DIELECTRIC_F0, Surfaces
from instrument.pictures.srgb import linear_from_srgb, srgb_from_linear

Array = NDArray[np.float64]

Pixels = NDArray[np.unsignedinteger[Any]]
"""Of 8 or 16 bits."""

FLIP_GREEN = np.array([1.0, -1.0, 1.0])
"""From the sample frame's normals, which are OpenGL's, to DirectX's."""


def quantised(values: Array, bits: int) -> Pixels:
    """Return values 0 to 1 as whole numbers of 8 or 16 bits."""
    whole: Array = np.round(np.clip(values, 0.0, 1.0) * (2**bits - 1))
    return np.asarray(whole, np.uint8) if bits == 8 else np.asarray(whole, np.uint16)


def _of_one(pixels: Pixels) -> Array:
    return pixels.astype(np.float64) / np.iinfo(pixels.dtype).max


@dataclass(frozen=True)
class Textures:
    """The maps of a surface in 8 or 16 bits, H x W pixels.

    Attributes
    ----------
    color : ndarray, shape (H, W, 3)
        sRGB.
    normal : ndarray, shape (H, W, 3)
        (n + 1) / 2, green up (OpenGL).
    roughness, metalness, clearcoat, clearcoat_roughness : ndarray, shape (H, W)
    specular : ndarray, shape (H, W)
        F0 / 0.08.
    displacement : ndarray, shape (H, W)
        0.5 + height / (2 `displacement_range_mm`).
    displacement_range_mm : float
        Height of the largest value above the mean plane, and of 0 below it.
    """

    color: Pixels
    normal: Pixels
    roughness: Pixels
    metalness: Pixels
    specular: Pixels
    clearcoat: Pixels
    clearcoat_roughness: Pixels
    displacement: Pixels
    displacement_range_mm: float


def textures(maps: SurfaceMaps, bits: int) -> Textures:
    """Encode maps in 8 or 16 bits."""
    surfaces, shape = maps.surfaces, maps.shape

    def of_map(values: Array) -> Pixels:
        return quantised(values.reshape(*shape, *values.shape[1:]), bits)

    height = max(float(np.abs(maps.displacement).max()), 1e-6)
    return Textures(
        color=of_map(srgb_from_linear(np.clip(surfaces.base_color, 0.0, 1.0))),
        normal=normal_pixels(maps.normals, bits),
        roughness=of_map(surfaces.roughness),
        metalness=of_map(surfaces.metallic),
        specular=of_map(surfaces.f0 / MAX_DIELECTRIC_F0),
        clearcoat=of_map(surfaces.clearcoat),
        clearcoat_roughness=of_map(surfaces.clearcoat_roughness),
        displacement=quantised(0.5 + maps.displacement / (2.0 * height), bits),
        displacement_range_mm=height,
    )


def normal_pixels(normals: Array, bits: int) -> Pixels:
    """Return unit vectors as (n + 1) / 2."""
    return quantised((normals + 1.0) / 2.0, bits)


def normals_of(pixels: Pixels) -> Array:
    """Return the unit vectors that `normal_pixels` made pixels of."""
    normals = 2.0 * _of_one(pixels) - 1.0
    return np.asarray(normals / np.linalg.norm(normals, axis=-1, keepdims=True))


def as_read(maps: SurfaceMaps, written: Textures) -> SurfaceMaps:
    """Return the maps as somebody has them who reads the textures."""

    def of_pixels(pixels: Pixels) -> Array:
        return _of_one(pixels).reshape(-1, *pixels.shape[2:])

    surfaces = Surfaces(
        base_color=linear_from_srgb(of_pixels(written.color)),
        metallic=of_pixels(written.metalness),
        f0=MAX_DIELECTRIC_F0 * of_pixels(written.specular),
        roughness=of_pixels(written.roughness),
        clearcoat=of_pixels(written.clearcoat),
        clearcoat_roughness=of_pixels(written.clearcoat_roughness),
    )
    height = (2.0 * _of_one(written.displacement) - 1.0) * written.displacement_range_mm
    return replace(maps, surfaces=surfaces, normals=normals_of(written.normal), displacement=height)


def png(pixels: Pixels, size_mm: tuple[float, float]) -> bytes:
    """Encode pixels (H, W), (H, W, 3) or with opacity (H, W, 4), with their size on the sample in its chunk pHYs."""
    # OpenCV has blue first.
    ordered: NDArray[Any] = pixels if pixels.ndim == 2 else pixels[..., [2, 1, 0, 3][: pixels.shape[2]]]
    done, encoded = cv2.imencode(".png", ordered)
    assert done, "OpenCV encodes any array of 8 or 16 bits"
    data = encoded.tobytes()
    per_metre = [round(n / (1e-3 * mm)) for n, mm in zip(pixels.shape[1::-1], size_mm, strict=True)]
    chunk = b"pHYs" + struct.pack(">IIB", *per_metre, 1)
    # After the signature and the header, which are 8 and 25 bytes long.
    return data[:33] + struct.pack(">I", 9) + chunk + struct.pack(">I", zlib.crc32(chunk)) + data[33:]
