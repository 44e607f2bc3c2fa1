"""Writes a MaterialX document beside the maps: OpenPBR and Autodesk's standard surface, of the same textures."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

from analysis.export.record import Record
from analysis.export.scenes.gltf import IOR
from instrument.files.whole_file import write_whole

VERSION = "1.39"

_COAT_IOR = 1.5

_IMAGES = {
    "Color": "color3",
    "NormalGL": "vector3",
    "Roughness": "float",
    "Metalness": "float",
    "Specular": "float",
    "Clearcoat": "float",
    "ClearcoatRoughness": "float",
    "Displacement": "float",
    "Mask": "float",
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
    coated, whole = (folder / f"{stem}_Clearcoat.png").exists(), bool(record.prepared.maps.solved.all())
    _graph(root, stem, coated=coated, whole=whole)
    height = SubElement(root, "displacement", name="height", type="displacementshader")
    _connect(height, "displacement", "float", "CentredHeight")
    _set(height, "scale", "float", f"{2e-3 * record.textures.displacement_range_mm:.9g}")
    _open_pbr(root, coated=coated, whole=whole)
    _standard_surface(root, coated=coated, whole=whole)
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode", xml_declaration=True)
    write_whole(folder / f"{stem}.mtlx", text + "\n")
    return {f"{stem}.mtlx": "MaterialX: `material_open_pbr` and `material_standard_surface`"}


def _graph(root: Element, stem: str, *, coated: bool, whole: bool) -> None:
    graph = SubElement(root, "nodegraph", name="maps")
    left_out = (() if coated else ("Clearcoat", "ClearcoatRoughness")) + (("Mask",) if whole else ())
    images = {name: kind for name, kind in _IMAGES.items() if name not in left_out}
    for name, kind in images.items():
        _image(graph, name, kind, f"{stem}_{name}.png")
    _node(graph, "normalmap", "Normal", "vector3", {"in": "NormalGL"})
    # OpenPBR weighs the reflectance of metals as well: there the weight is 1.
    _set(_node(graph, "mix", "SpecularWeight", "float", {"bg": "Specular", "mix": "Metalness"}), "fg", "float", "1")
    # In metres: 0.5 is the mean plane.
    _set(_node(graph, "subtract", "CentredHeight", "float", {"in1": "Displacement"}), "in2", "float", "0.5")
    outputs = {**images, "Normal": "vector3", "SpecularWeight": "float", "CentredHeight": "float"}
    if not whole:
        _node(graph, "convert", "MaskColor", "color3", {"in": "Mask"}, kind_in="float")
        outputs["MaskColor"] = "color3"
    for name, kind in outputs.items():
        if name not in {"NormalGL", "Displacement"}:
            SubElement(graph, "output", name=f"out_{name}", type=kind, nodename=name)


def _node(
    graph: Element, category: str, name: str, kind: str, inputs: dict[str, str], kind_in: str | None = None
) -> Element:
    node = SubElement(graph, category, name=name, type=kind)
    for slot, source in inputs.items():
        SubElement(node, "input", name=slot, type=kind_in or kind, nodename=source)
    return node


def _open_pbr(root: Element, *, coated: bool, whole: bool) -> None:
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
    if not whole:
        _connect(shader, "geometry_opacity", "float", "Mask")
    _material(root, "material_open_pbr", "open_pbr")


def _standard_surface(root: Element, *, coated: bool, whole: bool) -> None:
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
    if not whole:
        _connect(shader, "opacity", "color3", "MaskColor")
    _material(root, "material_standard_surface", "standard")


def _image(graph: Element, name: str, kind: str, file: str) -> None:
    image = SubElement(graph, "image", name=name, type=kind)
    where = SubElement(image, "input", name="file", type="filename", value=file)
    if kind == "color3":
        where.set("colorspace", "srgb_texture")
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
