"""Writes maps for artists: PNG of 16 bits and EXR, with a README of their conventions and `export.json`."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from analysis.drawing.picture_file import write_exr
from analysis.export.maps import SurfaceMaps
from analysis.export.microfacet import MAX_DIELECTRIC_F0
from analysis.export.options import Normals
from analysis.export.record import Record, record_text
from analysis.export.textures import FLIP_GREEN, Pixels, Textures, normal_pixels, png, quantised

Array = NDArray[np.float64]

BITS = 16

_README_NAME = "README.md"


class _Map(NamedTuple):
    name: str
    meaning: str
    pixels: Pixels
    linear: Array  # (H, W) or (H, W, 3), as the EXR holds it


def write_map_folder(folder: Path, stem: str, record: Record, normals: Normals) -> None:
    """Write the maps into a folder that is written whole.

    Parameters
    ----------
    folder : Path
        Its temporary name, with nothing there.
    stem : str
        What the files' names begin with.
    record : Record
        With textures of 16 bits.
    normals : Normals
    """
    folder.mkdir()
    maps = record.prepared.maps
    written = list(_maps(maps, record.textures, normals))
    for item in written:
        (folder / f"{stem}_{item.name}.png").write_bytes(png(item.pixels, maps.size_mm))
        write_exr(folder / f"{stem}_{item.name}.exr", {"RGB" if item.linear.ndim == 3 else "Y": item.linear})
    table = [(item.name, item.meaning) for item in written]
    n_materials = maps.material_shares.shape[-1]
    if n_materials:
        shares = {f"material{k:02d}": maps.material_shares[..., k] for k in range(n_materials)}
        write_exr(folder / f"{stem}_MaterialWeights.exr", shares)
        table.append(("MaterialWeights", "EXR only: a channel for each of the palette's materials, its share; sum 1"))
    figures = {**record.as_dict(), "maps": {f"{stem}_{name}": meaning for name, meaning in table}}
    (folder / "export.json").write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
    (folder / _README_NAME).write_text(_readme(stem, table, record), encoding="utf-8")


def add_to_readme(folder: Path, files: dict[str, str]) -> None:
    """Name files that stand beside the maps in their README."""
    if files:
        table = "".join(f"| `{name}` | {meaning} |\n" for name, meaning in files.items())
        with (folder / _README_NAME).open("a", encoding="utf-8") as file:
            file.write(f"\n| beside the maps | |\n|---|---|\n{table}")


def _maps(maps: SurfaceMaps, written: Textures, normals: Normals) -> Iterator[_Map]:
    surfaces, shape = maps.surfaces, maps.shape

    def linear(values: Array) -> Array:
        return values.reshape(*shape, *values.shape[1:])

    yield _Map("Color", "PNG sRGB, EXR linear", written.color, linear(surfaces.base_color))
    if normals != "directx":
        yield _Map("NormalGL", "(n + 1) / 2, green up; EXR: n", written.normal, maps.normals)
    if normals != "opengl":
        flipped = FLIP_GREEN * maps.normals
        yield _Map("NormalDX", "(n + 1) / 2, green down; EXR: n", normal_pixels(flipped, BITS), flipped)
    yield _Map("Roughness", "raw; alpha = roughness squared", written.roughness, linear(surfaces.roughness))
    yield _Map("Metalness", "raw; 1 metal, 0 dielectric", written.metalness, linear(surfaces.metallic))
    f0 = linear(surfaces.f0) / MAX_DIELECTRIC_F0
    yield _Map("Specular", "raw; F0 / 0.08 of a dielectric, 0.5 is an index of 1.5", written.specular, f0)
    if surfaces.clearcoat.any():
        yield _Map("Clearcoat", "raw; weight of the coat", written.clearcoat, linear(surfaces.clearcoat))
        coat_roughness = linear(surfaces.clearcoat_roughness)
        yield _Map("ClearcoatRoughness", "raw; of the coat", written.clearcoat_roughness, coat_roughness)
    height = f"PNG 0.5 is the mean plane, 0 and 1 are -+ {written.displacement_range_mm:.6g} mm; EXR in mm"
    yield _Map("Displacement", height, written.displacement, maps.displacement)
    yield _sigma(maps)
    mask = "1 solved, 0 not solved: there every map repeats the nearest solved pixel, and the normal is flat"
    yield _Map("Mask", mask, quantised(maps.solved.astype(np.float64), BITS), maps.solved.astype(np.float64))


def _sigma(maps: SurfaceMaps) -> _Map:
    most = float(np.nanmax(maps.normal_sigma_deg))
    meaning = (
        f"uncertainty of the normal, deg per axis: PNG 1 is {most:.6g} deg or not solved; EXR in deg, NaN not solved"
    )
    pixels = quantised(np.nan_to_num(maps.normal_sigma_deg / max(most, 1e-12), nan=1.0), BITS)
    return _Map("NormalSigma", meaning, pixels, maps.normal_sigma_deg)


_README = """# {stem}

Maps of a measured surface, made by halfangle. Row 0 is at the top. `export.json` has all figures.

| map | content |
|---|---|
{table}

Every map is there as PNG of 16 bits and as EXR of 32-bit floats. Load the PNG of Color as sRGB, everything else as
raw (non-colour) data.

- **Blender**: NormalGL through a Normal Map node, Specular into *Specular IOR Level*, Clearcoat into *Coat Weight*;
  Displacement with midlevel 0.5 and scale {twice_m:.6g} (in metres, for the PNG). The plane measures
  {width_m:.6g} x {height_m:.6g} m.
- **Substance, Unreal**: NormalDX; Specular as it is. **Unity, three.js, Godot**: NormalGL.
- Roughness is perceptual: alpha of GGX is its square.

```
{text}
```
"""


def _readme(stem: str, table: list[tuple[str, str]], record: Record) -> str:
    width, height = record.prepared.maps.size_mm
    return _README.format(
        stem=stem,
        table="\n".join(f"| `{stem}_{name}` | {meaning} |" for name, meaning in table),
        twice_m=2e-3 * record.textures.displacement_range_mm,
        width_m=1e-3 * width,
        height_m=1e-3 * height,
        text=record_text(record),
    )
