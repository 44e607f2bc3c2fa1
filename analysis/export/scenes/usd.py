"""Writes a USD scene as text beside the maps: a plane of true size with UsdPreviewSurface."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np

from analysis.export.map_folder import BITS
from analysis.export.record import Record
from analysis.export.scenes.gltf import IOR
from analysis.export.textures import png, quantised
from instrument.files.whole_file import write_whole

METRES_PER_UNIT = 0.001
"""Lengths are in mm, as everywhere in a result."""


def write_usd(folder: Path, stem: str, record: Record) -> dict[str, str]:
    """Write `<stem>.usda` into a folder of maps, and a map of indices of refraction, which say F0 in it.

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
    maps, height = record.prepared.maps, record.textures.displacement_range_mm
    root = np.sqrt(maps.surfaces.f0.reshape(maps.shape))
    ior = (1.0 + root) / (1.0 - root)
    write_whole(folder / f"{stem}_Ior.png", png(quantised((ior - 1.0) / (IOR - 1.0), BITS), maps.size_mm))
    coated, whole = (folder / f"{stem}_Clearcoat.png").exists(), bool(maps.solved.all())
    inputs = {
        "diffuseColor": ("color3f", _texture(stem, "Color", "rgb", "sRGB", (1.0, 0.0))),
        "normal": ("normal3f", _texture(stem, "NormalGL", "rgb", "raw", (2.0, -1.0))),
        "roughness": ("float", _texture(stem, "Roughness", "r", "raw", (1.0, 0.0))),
        "metallic": ("float", _texture(stem, "Metalness", "r", "raw", (1.0, 0.0))),
        "ior": ("float", _texture(stem, "Ior", "r", "raw", (IOR - 1.0, 1.0))),
        "displacement": ("float", _texture(stem, "Displacement", "r", "raw", (2.0 * height, -height))),
    }
    if coated:
        inputs["clearcoat"] = ("float", _texture(stem, "Clearcoat", "r", "raw", (1.0, 0.0)))
        inputs["clearcoatRoughness"] = ("float", _texture(stem, "ClearcoatRoughness", "r", "raw", (1.0, 0.0)))
    if not whole:
        inputs["opacity"] = ("float", _texture(stem, "Mask", "r", "raw", (1.0, 0.0)))
    text = _SCENE.format(
        name=_identifier(stem),
        metres=METRES_PER_UNIT,
        x=f"{maps.size_mm[0] / 2:.9g}",
        y=f"{maps.size_mm[1] / 2:.9g}",
        threshold="" if whole else "            float inputs:opacityThreshold = 0.5\n",
        connections="\n".join(
            f"            {kind} inputs:{name}.connect = <../{name}.outputs:{'rgb' if kind != 'float' else 'r'}>"
            for name, (kind, _) in inputs.items()
        ),
        textures="\n".join(shader.format(name=name) for name, (_, shader) in inputs.items()),
    )
    write_whole(folder / f"{stem}.usda", text)
    return {
        f"{stem}.usda": "USD: a plane in mm with UsdPreviewSurface",
        f"{stem}_Ior.png": f"raw; index of refraction, 0 is 1 and 1 is {IOR:.6g}",
    }


def _identifier(text: str) -> str:
    word = re.sub(r"\W", "_", text, flags=re.ASCII)
    return word if word[:1].isalpha() else f"_{word}"


def _texture(stem: str, name: str, output: str, space: str, scale_bias: tuple[float, float]) -> str:
    scale, bias = (
        f"({value:.9g}, {value:.9g}, {value:.9g}, {rest})" for value, rest in zip(scale_bias, (1, 0), strict=True)
    )
    kind = "float3" if output == "rgb" else "float"
    file = f"@./{stem}_{name}.png@"
    return f"""
        def Shader "{{name}}"
        {{{{
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = {file}
            token inputs:sourceColorSpace = {json.dumps(space)}
            float2 inputs:st.connect = <../st.outputs:result>
            token inputs:wrapS = "clamp"
            token inputs:wrapT = "clamp"
            float4 inputs:scale = {scale}
            float4 inputs:bias = {bias}
            {kind} outputs:{output}
        }}}}"""


_SCENE = """#usda 1.0
(
    defaultPrim = "{name}"
    metersPerUnit = {metres}
    upAxis = "Z"
)

def Xform "{name}" (
    kind = "component"
)
{{
    def Mesh "plane" (
        prepend apiSchemas = ["MaterialBindingAPI"]
    )
    {{
        uniform token subdivisionScheme = "none"
        float3[] extent = [(-{x}, -{y}, 0), ({x}, {y}, 0)]
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-{x}, -{y}, 0), ({x}, -{y}, 0), ({x}, {y}, 0), (-{x}, {y}, 0)]
        normal3f[] normals = [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)] (
            interpolation = "vertex"
        )
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1)] (
            interpolation = "vertex"
        )
        rel material:binding = </{name}/surface>
    }}

    def Material "surface"
    {{
        token outputs:surface.connect = <preview.outputs:surface>
        token outputs:displacement.connect = <preview.outputs:displacement>

        def Shader "preview"
        {{
            uniform token info:id = "UsdPreviewSurface"
            int inputs:useSpecularWorkflow = 0
{threshold}{connections}
            token outputs:surface
            token outputs:displacement
        }}

        def Shader "st"
        {{
            uniform token info:id = "UsdPrimvarReader_float2"
            string inputs:varname = "st"
            float2 outputs:result
        }}
{textures}
    }}
}}
"""
