"""Writes a MaterialX document beside the maps: OpenPBR and Autodesk's standard surface, of the same textures."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

from analysis.export.record import Record
from analysis.export.scenes.gltf import IOR

VERSION = "1.39"

_COAT_IOR = 1.5

_IMAGES = {
    "Color": ("color3", "srgb_texture"),
    "NormalGL": ("vector3", None),
    "Roughness": ("float", None),
    "Metalness": ("float", None),
    "Specular": ("float", None),
    "Clearcoat": ("float", None),
    "ClearcoatRoughness": ("float", None),
    "Displacement": ("float", None),
}


def write_materialx(folder: Path, stem: str, record: Record) -> dict[str, str]:
    """Write `<stem>.mtlx` into a folder of maps.

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
    root = Element("materialx", version=VERSION, colorspace="lin_rec709")
    graph = SubElement(root, "nodegraph", name="maps")
    coated = (folder / f"{stem}_Clearcoat.png").exists()
    for name, (kind, space) in _IMAGES.items():
        if coated or not name.startswith("Clearcoat"):
            _image(graph, name, kind, f"{stem}_{name}.png", space)
    normal = SubElement(graph, "normalmap", name="Normal", type="vector3")
    SubElement(normal, "input", name="in", type="vector3", nodename="NormalGL")
    # OpenPBR weighs the reflectance of metals as well: there the weight is 1.
    weight = SubElement(graph, "mix", name="SpecularWeight", type="float")
    SubElement(weight, "input", name="bg", type="float", nodename="Specular")
    SubElement(weight, "input", name="fg", type="float", value="1")
    SubElement(weight, "input", name="mix", type="float", nodename="Metalness")
    # In metres: 0.5 is the mean plane.
    centred = SubElement(graph, "subtract", name="CentredHeight", type="float")
    SubElement(centred, "input", name="in1", type="float", nodename="Displacement")
    SubElement(centred, "input", name="in2", type="float", value="0.5")
    outputs = {"Color": "color3", "Normal": "vector3", "CentredHeight": "float", "SpecularWeight": "float"}
    outputs |= dict.fromkeys(("Roughness", "Metalness", "Specular"), "float")
    outputs |= dict.fromkeys(("Clearcoat", "ClearcoatRoughness"), "float") if coated else {}
    for name, kind in outputs.items():
        SubElement(graph, "output", name=f"out_{name}", type=kind, nodename=name)
    height = SubElement(root, "displacement", name="height", type="displacementshader")
    _connect(height, "displacement", "float", "CentredHeight")
    _set(height, "scale", "float", f"{2e-3 * record.textures.displacement_range_mm:.9g}")
    _open_pbr(root, coated=coated)
    _standard_surface(root, coated=coated)
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode", xml_declaration=True)
    (folder / f"{stem}.mtlx").write_text(text + "\n", encoding="utf-8")
    return {f"{stem}.mtlx": "MaterialX: `material_open_pbr` and `material_standard_surface`"}


def _open_pbr(root: Element, *, coated: bool) -> None:
    shader = SubElement(root, "open_pbr_surface", name="open_pbr", type="surfaceshader")
    _connect(shader, "base_color", "color3", "Color")
    _connect(shader, "base_metalness", "float", "Metalness")
    _connect(shader, "specular_weight", "float", "SpecularWeight")
    _set(shader, "specular_ior", "float", f"{IOR:.7g}")
    _connect(shader, "specular_roughness", "float", "Roughness")
    _connect(shader, "geometry_normal", "vector3", "Normal")
    if coated:
        _connect(shader, "coat_weight", "float", "Clearcoat")
        _connect(shader, "coat_roughness", "float", "ClearcoatRoughness")
        _set(shader, "coat_ior", "float", f"{_COAT_IOR:g}")
        # Colours were fitted without what a coat sends back into the base.
        _set(shader, "coat_darkening", "float", "0")
        _connect(shader, "geometry_coat_normal", "vector3", "Normal")
    _material(root, "material_open_pbr", "open_pbr")


def _standard_surface(root: Element, *, coated: bool) -> None:
    shader = SubElement(root, "standard_surface", name="standard", type="surfaceshader")
    _set(shader, "base", "float", "1")
    _connect(shader, "base_color", "color3", "Color")
    _connect(shader, "metalness", "float", "Metalness")
    _connect(shader, "specular", "float", "Specular")
    _set(shader, "specular_IOR", "float", f"{IOR:.7g}")
    _connect(shader, "specular_roughness", "float", "Roughness")
    _connect(shader, "normal", "vector3", "Normal")
    if coated:
        _connect(shader, "coat", "float", "Clearcoat")
        _connect(shader, "coat_roughness", "float", "ClearcoatRoughness")
        _set(shader, "coat_IOR", "float", f"{_COAT_IOR:g}")
        _connect(shader, "coat_normal", "vector3", "Normal")
    _material(root, "material_standard_surface", "standard")


def _image(graph: Element, name: str, kind: str, file: str, space: str | None) -> None:
    image = SubElement(graph, "image", name=name, type=kind)
    where = SubElement(image, "input", name="file", type="filename", value=file)
    if space:
        where.set("colorspace", space)
    for side in ("uaddressmode", "vaddressmode"):
        _set(image, side, "string", "clamp")


def _material(root: Element, name: str, shader: str) -> None:
    material = SubElement(root, "surfacematerial", name=name, type="material")
    SubElement(material, "input", name="surfaceshader", type="surfaceshader", nodename=shader)
    SubElement(material, "input", name="displacementshader", type="displacementshader", nodename="height")


def _connect(node: Element, name: str, kind: str, output: str) -> None:
    SubElement(node, "input", name=name, type=kind, nodegraph="maps", output=f"out_{output}")


def _set(node: Element, name: str, kind: str, value: str) -> None:
    SubElement(node, "input", name=name, type=kind, value=value)
