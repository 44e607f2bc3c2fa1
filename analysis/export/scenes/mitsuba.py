"""Writes a scene for Mitsuba 3 beside the maps: a rectangle in mm with the principled BSDF, a camera and a light."""

from __future__ import annotations

import math
from pathlib import Path
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

from analysis.export.map_folder import BITS
from analysis.export.maps import SurfaceMaps
from analysis.export.microfacet import MAX_DIELECTRIC_F0
from analysis.export.record import Record
from analysis.export.textures import png, quantised
from instrument.files.whole_file import write_whole
from instrument.pictures.srgb import srgb_from_linear

_DISTANCE = 5.0  # of camera and light, times the longer side


def write_mitsuba(folder: Path, stem: str, record: Record) -> dict[str, str]:
    """Write `<stem>.xml` into a folder of maps.

    The principled BSDF has one strength of its specular lobe for all pixels, of metals as well: two of them, without a
    lobe and with the largest, are blended by a map of their own. It does not take from the diffuse part what the lobe
    gives back, so that its colours are those times 1 - F0. Its clear coat is a quarter as strong as glTF's.

    Parameters
    ----------
    folder : Path
    stem : str
        What the maps' names begin with.
    record : Record

    Returns
    -------
    dict of str to str
        What each file is, by its name.
    """
    maps = record.prepared.maps
    _write_own_maps(folder, stem, maps)
    scene = Element("scene", version="3.0.0")
    SubElement(SubElement(scene, "integrator", type="direct"), "boolean", name="hide_emitters", value="true")
    _add_camera_and_light(scene, maps)
    _add_rectangle(scene, stem, maps, coated=(folder / f"{stem}_Clearcoat.png").exists())
    ET.indent(scene)
    text = ET.tostring(scene, encoding="unicode", xml_declaration=True)
    write_whole(folder / f"{stem}.xml", text + "\n")
    return {
        f"{stem}.xml": "Mitsuba 3: a rectangle in mm, a camera and a point light",
        f"{stem}_SpecularWeight.png": "raw; as Specular, 1 for metals",
        f"{stem}_DimmedColor.png": "sRGB; Color times 1 - F0",
    }


def _write_own_maps(folder: Path, stem: str, maps: SurfaceMaps) -> None:
    metallic, f0 = maps.surfaces.metallic.reshape(maps.shape), maps.surfaces.f0.reshape(maps.shape)
    weight = metallic + (1.0 - metallic) * f0 / MAX_DIELECTRIC_F0
    color = maps.surfaces.base_color.reshape(*maps.shape, 3) * (1.0 - (1.0 - metallic) * f0)[..., None]
    for name, values in (("SpecularWeight", weight), ("DimmedColor", srgb_from_linear(color))):
        write_whole(folder / f"{stem}_{name}.png", png(quantised(values, BITS), maps.size_mm))


def _add_camera_and_light(scene: Element, maps: SurfaceMaps) -> None:
    """Look down on the whole area, with a light of radiance about 1 a third of the way aside."""
    distance = _DISTANCE * max(maps.size_mm)
    sensor = SubElement(scene, "sensor", type="perspective")
    SubElement(sensor, "float", name="fov", value=f"{2.0 * math.degrees(math.atan(0.5 / _DISTANCE)):.9g}")
    SubElement(sensor, "string", name="fov_axis", value="larger")
    placed = SubElement(sensor, "transform", name="to_world")
    SubElement(placed, "lookat", origin=f"0, 0, {distance:.9g}", target="0, 0, 0", up="0, 1, 0")
    film = SubElement(sensor, "film", type="hdrfilm")
    for name, n in zip(("height", "width"), maps.shape, strict=True):
        SubElement(film, "integer", name=name, value=str(n))
    SubElement(film, "rfilter", type="box")
    light = SubElement(scene, "emitter", type="point")
    SubElement(light, "point", name="position", x=f"{distance / 3:.9g}", y="0", z=f"{distance:.9g}")
    SubElement(light, "rgb", name="intensity", value=f"{3.0 * distance**2:.9g}")


def _add_rectangle(scene: Element, stem: str, maps: SurfaceMaps, *, coated: bool) -> None:
    shape = SubElement(scene, "shape", type="rectangle")
    placed = SubElement(shape, "transform", name="to_world")
    width, height = maps.size_mm
    SubElement(placed, "scale", x=f"{width / 2:.9g}", y=f"{height / 2:.9g}", z="1")
    if not maps.solved.all():
        # What was not solved is a hole.
        shape = SubElement(shape, "bsdf", type="mask")
        _bitmap(shape, "opacity", f"{stem}_Mask.png")
    bent = SubElement(shape, "bsdf", type="normalmap")
    _bitmap(bent, "normalmap", f"{stem}_NormalGL.png")
    blend = SubElement(bent, "bsdf", type="blendbsdf")
    _bitmap(blend, "weight", f"{stem}_SpecularWeight.png")
    for specular in (0.0, 1.0):
        _principled(blend, stem, specular, coated=coated)


def _principled(parent: Element, stem: str, specular: float, *, coated: bool) -> None:
    bsdf = SubElement(parent, "bsdf", type="principled")
    _bitmap(bsdf, "base_color", f"{stem}_DimmedColor.png", raw=False)
    _bitmap(bsdf, "metallic", f"{stem}_Metalness.png")
    _bitmap(bsdf, "roughness", f"{stem}_Roughness.png")
    SubElement(bsdf, "float", name="specular", value=f"{specular:g}")
    if coated:
        _bitmap(bsdf, "clearcoat", f"{stem}_Clearcoat.png")


def _bitmap(parent: Element, name: str, file: str, *, raw: bool = True) -> None:
    texture = SubElement(parent, "texture", type="bitmap", name=name)
    SubElement(texture, "string", name="filename", value=file)
    SubElement(texture, "boolean", name="raw", value=str(raw).lower())
    SubElement(texture, "string", name="wrap_mode", value="clamp")
    # A rectangle's v points up, and the first row of a picture is at v = 0.
    turned = SubElement(texture, "transform", name="to_uv")
    SubElement(turned, "scale", x="1", y="-1")
    SubElement(turned, "translate", x="0", y="1")
