"""Writes a scene for Mitsuba 3 beside the maps: a rectangle in mm with the principled BSDF, a camera and a light."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

from analysis.export.map_folder import BITS
from analysis.export.maps import SurfaceMaps
from analysis.export.microfacet import MAX_DIELECTRIC_F0
from analysis.export.record import Record
from analysis.export.textures import png, quantised
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
    width, height = maps.size_mm
    rows, columns = maps.shape
    distance = _DISTANCE * max(width, height)
    _write_own_maps(folder, stem, maps)
    scene = Element("scene", version="3.0.0")
    SubElement(SubElement(scene, "integrator", type="direct"), "boolean", name="hide_emitters", value="true")
    sensor = SubElement(scene, "sensor", type="perspective")
    # Half of the area is seen under arctan(1 / 10) of the longer side.
    SubElement(sensor, "float", name="fov", value=f"{11.4211862:g}")
    SubElement(sensor, "string", name="fov_axis", value="larger")
    _look_down(sensor, distance)
    film = SubElement(sensor, "film", type="hdrfilm")
    SubElement(film, "integer", name="width", value=str(columns))
    SubElement(film, "integer", name="height", value=str(rows))
    SubElement(film, "rfilter", type="box")
    light = SubElement(scene, "emitter", type="point")
    SubElement(light, "point", name="position", x=f"{distance / 3:.9g}", y="0", z=f"{distance:.9g}")
    SubElement(light, "rgb", name="intensity", value=f"{3.0 * distance**2:.9g}")
    shape = SubElement(scene, "shape", type="rectangle")
    placed = SubElement(shape, "transform", name="to_world")
    SubElement(placed, "scale", x=f"{width / 2:.9g}", y=f"{height / 2:.9g}", z="1")
    bent = SubElement(shape, "bsdf", type="normalmap")
    _bitmap(bent, "normalmap", f"{stem}_NormalGL.png")
    blend = SubElement(bent, "bsdf", type="blendbsdf")
    _bitmap(blend, "weight", f"{stem}_SpecularWeight.png")
    coated = (folder / f"{stem}_Clearcoat.png").exists()
    for specular in (0.0, 1.0):
        _principled(blend, stem, specular, coated=coated)
    ET.indent(scene)
    text = ET.tostring(scene, encoding="unicode", xml_declaration=True)
    (folder / f"{stem}.xml").write_text(text + "\n", encoding="utf-8")
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
        (folder / f"{stem}_{name}.png").write_bytes(png(quantised(values, BITS), maps.size_mm))


def _look_down(sensor: Element, distance: float) -> None:
    placed = SubElement(sensor, "transform", name="to_world")
    SubElement(placed, "lookat", origin=f"0, 0, {distance:.9g}", target="0, 0, 0", up="0, 1, 0")


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
