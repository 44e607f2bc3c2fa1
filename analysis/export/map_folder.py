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
from instrument.files.whole_file import write_whole, written_whole

Array = NDArray[np.float64]

BITS = 16


class _Map(NamedTuple):
    name: str
    meaning: str
    pixels: Pixels
    linear: Array  # (H, W) or (H, W, 3), as the EXR holds it


def write_map_folder(folder: Path, stem: str, record: Record, normals: Normals) -> dict[str, str]:
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

    Returns
    -------
    dict of str to str
        What each map is, by its name without an ending.
    """
    folder.mkdir()
    maps = record.prepared.maps
    meanings = {}
    for item in _maps(maps, record.textures, normals):
        name = f"{stem}_{item.name}"
        meanings[name] = item.meaning
        write_whole(folder / f"{name}.png", png(item.pixels, maps.size_mm))
        _write_exr(folder / f"{name}.exr", {"RGB" if item.linear.ndim == 3 else "Y": item.linear})
    n_materials = maps.material_shares.shape[-1]
    if n_materials:
        name = f"{stem}_MaterialWeights"
        meanings[name] = "EXR only: a channel for each of the palette's materials, its share; sum 1"
        shares = {f"material{k:02d}": maps.material_shares[..., k] for k in range(n_materials)}
        _write_exr(folder / f"{name}.exr", shares)
    return meanings


def write_record(folder: Path, stem: str, record: Record, maps: dict[str, str], beside: dict[str, str]) -> None:
    """Write what is to be known of a folder: `export.json` for programs and a README for people.

    Parameters
    ----------
    folder : Path
    stem : str
    record : Record
    maps, beside : dict of str to str
        What each map, and each file beside them, is.
    """
    figures = {**record.as_dict(), "maps": maps, "beside": beside}
    write_whole(folder / "export.json", json.dumps(figures, indent=2) + "\n")
    width, height = record.prepared.maps.size_mm
    page = _README.format(
        stem=stem,
        table="\n".join(f"| `{name}` | {meaning} |" for name, meaning in (maps | beside).items()),
        twice_m=2e-3 * record.textures.displacement_range_mm,
        width_m=1e-3 * width,
        height_m=1e-3 * height,
        text=record_text(record),
    )
    write_whole(folder / "README.md", page)


def _write_exr(path: Path, channels: dict[str, Array]) -> None:
    with written_whole(path) as part:
        write_exr(part, channels)


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

What has no ending here is there as PNG of 16 bits and as EXR of 32-bit floats. Load the PNG of Color as sRGB,
everything else as raw (non-colour) data.

- **Blender**: NormalGL through a Normal Map node, Specular into *Specular IOR Level*, Clearcoat into *Coat Weight*;
  Displacement with midlevel 0.5 and scale {twice_m:.6g} (in metres, for the PNG). The plane measures
  {width_m:.6g} x {height_m:.6g} m.
- **Substance, Unreal**: NormalDX; Specular as it is. **Unity, three.js, Godot**: NormalGL.
- Roughness is perceptual: alpha of GGX is its square.

```
{text}
```
"""
