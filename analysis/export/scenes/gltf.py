"""Writes glTF 2.0 in one binary file: a plane or a mesh in metres with its material, the maps inside.

The sample frame is glTF's: x right, y up, z towards the viewer. Normals and tangents of the vertices are those of the
mean plane also on a mesh, since the normal map is relative to it: what is shaded are the measured normals.
"""

from __future__ import annotations

import json
import struct
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.export.microfacet import MAX_DIELECTRIC_F0
from analysis.export.record import Record
from analysis.export.scenes.mesh import Mesh
from analysis.export.textures import Pixels, png, quantised
from instrument.pictures.srgb import srgb_from_linear

BITS = 8
"""What programs that read glTF keep of a texture."""

SUFFIX = ".glb"

IOR = (1.0 + MAX_DIELECTRIC_F0**0.5) / (1.0 - MAX_DIELECTRIC_F0**0.5)
"""Index of refraction of the largest F0: the specular colour says how much of it a pixel has, and F90 stays 1."""

_MAGIC, _VERSION, _JSON, _BINARY = b"glTF", 2, b"JSON", b"BIN\0"
_FLOAT, _UINT, _ARRAY, _INDICES = 5126, 5125, 34962, 34963
_LINEAR, _MIPMAPS, _CLAMP = 9729, 9987, 33071


@dataclass
class _Document:
    """What a file holds, while it is put together."""

    binary: bytearray = field(default_factory=bytearray)
    views: list[dict[str, Any]] = field(default_factory=list)
    accessors: list[dict[str, Any]] = field(default_factory=list)
    images: list[dict[str, Any]] = field(default_factory=list)

    def add_view(self, data: bytes, target: int | None = None) -> int:
        # Every view begins at a multiple of four bytes, as accessors want it.
        self.binary += bytes(-len(self.binary) % 4)
        view = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)}
        self.views.append(view if target is None else {**view, "target": target})
        self.binary += data
        return len(self.views) - 1

    def add_array(self, values: NDArray[Any], target: int, *, limits: bool = False) -> int:
        kind = "SCALAR" if values.ndim == 1 else f"VEC{values.shape[1]}"
        accessor = {
            "bufferView": self.add_view(np.ascontiguousarray(values).tobytes(), target),
            "componentType": _UINT if values.dtype == np.uint32 else _FLOAT,
            "count": len(values),
            "type": kind,
        }
        if limits:
            accessor |= {"min": values.min(axis=0).tolist(), "max": values.max(axis=0).tolist()}
        self.accessors.append(accessor)
        return len(self.accessors) - 1

    def add_texture(self, name: str, pixels: Pixels, size_mm: tuple[float, float]) -> dict[str, int]:
        view = self.add_view(png(pixels, size_mm))
        self.images.append({"name": name, "mimeType": "image/png", "bufferView": view})
        return {"index": len(self.images) - 1}


def write_gltf(path: Path, name: str, record: Record, mesh: Mesh) -> None:
    """Write a .glb at the temporary name of a file.

    Parameters
    ----------
    path : Path
    name : str
        Of the object and its material.
    record : Record
        With textures of 8 bits; goes into the file's extras.
    mesh : Mesh
    """
    document = _Document()
    material = {"name": name, **_material(document, record)}
    primitive = {"attributes": _attributes(document, mesh), "indices": 0, "material": 0}
    primitive["indices"] = document.add_array(mesh.triangles.ravel(), _INDICES)
    extensions = sorted(material["extensions"])
    content = {
        "asset": {"version": "2.0", "generator": "halfangle", "extras": {"halfangle": record.as_dict()}},
        "extensionsUsed": extensions,
        "scene": 0,
        "scenes": [{"nodes": [0]}],
        "nodes": [{"name": name, "mesh": 0}],
        "meshes": [{"name": name, "primitives": [primitive]}],
        "materials": [material],
        "textures": [{"sampler": 0, "source": i} for i in range(len(document.images))],
        "images": document.images,
        "samplers": [{"magFilter": _LINEAR, "minFilter": _MIPMAPS, "wrapS": _CLAMP, "wrapT": _CLAMP}],
        "accessors": document.accessors,
        "bufferViews": document.views,
        "buffers": [{"byteLength": len(document.binary)}],
    }
    path.write_bytes(_packed(json.dumps(content).encode(), bytes(document.binary)))


def _packed(text: bytes, binary: bytes) -> bytes:
    text += b" " * (-len(text) % 4)
    binary += bytes(-len(binary) % 4)
    n_bytes = 12 + 8 + len(text) + 8 + len(binary)
    head = _MAGIC + struct.pack("<II", _VERSION, n_bytes)
    return b"".join([head, struct.pack("<I", len(text)), _JSON, text, struct.pack("<I", len(binary)), _BINARY, binary])


def _attributes(document: _Document, mesh: Mesh) -> dict[str, int]:
    n = len(mesh.points)
    up, right = (np.tile(np.array(a, np.float32), (n, 1)) for a in ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0, 1.0)))
    metres = (1e-3 * mesh.points).astype(np.float32)
    return {
        "POSITION": document.add_array(metres, _ARRAY, limits=True),
        "NORMAL": document.add_array(up, _ARRAY),
        "TANGENT": document.add_array(right, _ARRAY),
        "TEXCOORD_0": document.add_array(mesh.uv.astype(np.float32), _ARRAY),
    }


def _material(document: _Document, record: Record) -> dict[str, Any]:
    maps, written = record.prepared.maps, record.textures
    full = np.full_like(written.roughness, np.iinfo(written.roughness.dtype).max)

    def texture(name: str, pixels: Pixels) -> dict[str, int]:
        return document.add_texture(name, pixels, maps.size_mm)

    color = written.color
    if not maps.solved.all():
        # What was not solved is a hole.
        color = np.concatenate([color, quantised(maps.solved.astype(np.float64), BITS)[..., None]], axis=-1)
    specular = srgb_from_linear(written.specular / np.iinfo(written.specular.dtype).max)
    normal = texture("normal", written.normal)
    material: dict[str, Any] = {
        "pbrMetallicRoughness": {
            "baseColorTexture": texture("color", color),
            "metallicRoughnessTexture": texture(
                "roughness, metalness", np.stack([full, written.roughness, written.metalness], axis=-1)
            ),
        },
        "normalTexture": normal,
        "extensions": {
            "KHR_materials_ior": {"ior": IOR},
            "KHR_materials_specular": {
                "specularColorTexture": texture("specular", np.repeat(quantised(specular, BITS)[..., None], 3, axis=-1))
            },
        },
    }
    if not maps.solved.all():
        material["alphaMode"] = "MASK"
    if written.clearcoat.any():
        coat = texture("clearcoat", np.stack([written.clearcoat, written.clearcoat_roughness, 0 * full], axis=-1))
        material["extensions"]["KHR_materials_clearcoat"] = {
            "clearcoatFactor": 1.0,
            "clearcoatTexture": coat,
            "clearcoatRoughnessFactor": 1.0,
            "clearcoatRoughnessTexture": coat,
            "clearcoatNormalTexture": normal,
        }
    return material
