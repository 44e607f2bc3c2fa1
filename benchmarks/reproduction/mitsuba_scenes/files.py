"""A scene as Mitsuba reads it: XML, two meshes and textures in a folder."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from string import Template
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from benchmarks.reproduction.mitsuba_scenes.plate import HALF_PLATE_MM, print_on_plate, ring
from benchmarks.reproduction.mitsuba_scenes.scenes import Scene
from benchmarks.reproduction.mitsuba_scenes.surfaces import HALF_WIDTH_MM, Surface
from benchmarks.reproduction.mitsuba_scenes.views import Camera
from instrument.files.whole_file import write_whole

Array = NDArray[np.float64]

SCENE_FILE = "scene.xml"

INTENSITY = 3.0e5
"""Of the light: white paper comes to about 0.6 at the working distance."""

_N_TEXELS = 1024

_XML = Template("""<scene version="3.0.0">
  <integrator type="path"> <integer name="max_depth" value="$max_depth"/> </integrator>
  <sensor type="perspective" id="camera">
    <float name="fov" value="$fov_deg"/> <string name="fov_axis" value="x"/>
    <float name="near_clip" value="1"/> <float name="far_clip" value="10000"/>
    <sampler type="independent"/>
    <film type="hdrfilm">
      <integer name="width" value="$width"/> <integer name="height" value="$height"/>
      <string name="pixel_format" value="rgb"/> <string name="component_format" value="float32"/>
      <rfilter type="box"/>
    </film>
  </sensor>
  <emitter type="point" id="lamp">
    <rgb name="intensity" value="$intensity"/> <point name="position" x="0" y="0" z="350"/>
  </emitter>
  <shape type="ply">
    <string name="filename" value="plate.ply"/>
    <bsdf type="diffuse">
      <texture type="bitmap" name="reflectance">
        <string name="filename" value="plate.png"/> <boolean name="raw" value="true"/>
        <string name="filter_type" value="nearest"/>
      </texture>
    </bsdf>
  </shape>
  <shape type="ply">
    <string name="filename" value="relief.ply"/>$materials
  </shape>
</scene>
""")


@dataclass(frozen=True)
class Rendering:
    """How a scene is rendered.

    Attributes
    ----------
    camera : Camera
    samples : int
        Paths a pixel.
    max_depth : int
        Most segments of a path after the lens: 2 is direct light alone, 4 adds two bounces between surfaces.
    mesh_pitch_mm : float
        Distance of the relief's vertices.
    """

    camera: Camera
    samples: int
    max_depth: int = 4
    mesh_pitch_mm: float = 0.1


def write_scene(folder: Path, scene: Scene, rendering: Rendering) -> None:
    """Write a scene into a folder, over what is there."""
    folder.mkdir(parents=True, exist_ok=True)
    textures = _write_textures(folder, scene)
    write_ply(folder / "plate.ply", *_plate())
    write_ply(folder / "relief.ply", *relief_mesh(scene.surface, rendering.mesh_pitch_mm))
    _write_png(folder / "plate.png", print_on_plate())
    text = scene_text(rendering, scene.materials.format(**textures))
    write_whole(folder / SCENE_FILE, text, overwrite=True)


def scene_text(rendering: Rendering, materials: str) -> str:
    """Return the scene's XML, with the BSDF of its relief filled in."""
    camera = rendering.camera
    return _XML.substitute(
        max_depth=rendering.max_depth,
        fov_deg=repr(camera.field_of_view_deg),
        width=camera.width,
        height=camera.height,
        intensity=INTENSITY,
        materials=materials,
    )


def relief_mesh(surface: Surface, pitch: float) -> tuple[Array, Array, Array, NDArray[np.int32]]:
    """Return vertices, normals (both (n, 3)), texture coordinates (n, 2) and triangles (m, 3) of a relief."""
    side = round(2 * HALF_WIDTH_MM / pitch) + 1
    x, y = np.meshgrid(*[np.linspace(-HALF_WIDTH_MM, HALF_WIDTH_MM, side)] * 2)
    vertices = np.stack([x, y, surface.height(x, y)], axis=-1).reshape(-1, 3)
    index = np.arange(side * side, dtype=np.int32).reshape(side, side)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2).reshape(-1, 3)
    return vertices, surface.normals(x, y).reshape(-1, 3), _texture_coordinates(vertices, HALF_WIDTH_MM), faces


def _plate() -> tuple[Array, Array, Array, NDArray[np.int32]]:
    vertices, faces = ring()
    up = np.broadcast_to([0.0, 0.0, 1.0], vertices.shape)
    return vertices, np.asarray(up), _texture_coordinates(vertices, HALF_PLATE_MM), faces


def _texture_coordinates(vertices: Array, half_width: float) -> Array:
    # Mitsuba puts a texture's row 0, our top, at v = 0.
    return np.asarray(0.5 + 0.5 * vertices[:, :2] * [1.0, -1.0] / half_width)


def write_ply(path: Path, vertices: Array, normals: Array, uv: Array, faces: NDArray[np.int32]) -> None:
    """Write a mesh of triangles as binary PLY."""
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz", "u", "v")]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    triangles = np.empty(len(faces), [("n", "u1"), ("corners", "<i4", 3)])
    triangles["n"], triangles["corners"] = 3, faces
    content = np.hstack([vertices, normals, uv]).astype("<f4").tobytes() + triangles.tobytes()
    write_whole(path, "\n".join(header).encode() + content, overwrite=True)


def _write_png(path: Path, counts: NDArray[np.integer[Any]]) -> None:
    write_whole(path, cv2.imencode(".png", counts)[1].tobytes(), overwrite=True)


def _write_textures(folder: Path, scene: Scene) -> dict[str, str]:
    """Write a scene's textures, row 0 at the top; return the XML element of each."""
    u = ((np.arange(_N_TEXELS) + 0.5) / _N_TEXELS * 2.0 - 1.0) * HALF_WIDTH_MM
    x, y = np.meshgrid(u, -u)
    elements = {}
    for name, values in scene.textures(x, y).items():
        counts = np.rint(np.clip(values, 0.0, 1.0) * 65535.0).astype(np.uint16)
        _write_png(folder / f"{name}.png", counts[..., ::-1] if counts.ndim == 3 else counts)
        # blendbsdf names its texture "weight" whatever it means.
        parameter = name if name in ("base_color", "roughness") else "weight"
        elements[name] = (
            f'<texture type="bitmap" name="{parameter}"> <string name="filename" value="{name}.png"/>'
            ' <boolean name="raw" value="true"/> </texture>'
        )
    return elements
