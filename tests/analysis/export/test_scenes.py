"""Scenes in the formats of other programs, read again by readers of our own and, where installed, by theirs."""

from __future__ import annotations

import json
import shutil
import struct
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import cv2
import numpy as np
import pytest

from analysis.export.comparison import position
from analysis.export.export import export_result
from analysis.export.options import ExportOptions, Target
from analysis.reflectance.dictionary import parametric
from analysis.reflectance.merl import SCALES, cell_angles, read_merl
from analysis.reflectance.models import cosines_from_angles
from analysis.results.result import Result
from instrument.files.validation import InvalidInputError
from instrument.pictures.srgb import linear_from_srgb
from tests.analysis.export.gltf_shading import Surface, gltf_picture, psnr
from tests.analysis.export.scene import GOLD, PITCH, SIZE, atoms, material_map, small_result

SIDE_MM = SIZE * PITCH

VALIDATE = """
const validator = require('gltf-validator'), fs = require('fs');
validator.validateBytes(new Uint8Array(fs.readFileSync(process.argv[1]))).then(
    report => console.log(JSON.stringify(report.issues)));
"""


@pytest.fixture(scope="module")
def result() -> Result:
    return small_result()


def exported(result: Result, path: Path, target: Target, **choices: Any) -> Path:
    export_result(result, path, ExportOptions(target=target, white_reflectance=1.0, **choices), "area.result.h5")
    return path


@pytest.fixture(scope="module")
def glb(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(result, tmp_path_factory.mktemp("gltf") / "area.glb", "gltf")


@pytest.fixture(scope="module")
def mesh(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(result, tmp_path_factory.mktemp("gltf") / "mesh.glb", "gltf", mesh=80)


class Glb:
    """A .glb, taken apart."""

    def __init__(self, path: Path) -> None:
        data = path.read_bytes()
        magic, version, n_bytes, n_json, kind = struct.unpack("<4sIII4s", data[:20])
        assert (magic, version, n_bytes, kind) == (b"glTF", 2, len(data), b"JSON")
        self.content = json.loads(data[20 : 20 + n_json])
        n_binary, kind = struct.unpack("<I4s", data[20 + n_json : 28 + n_json])
        assert kind == b"BIN\0"
        self.binary = data[28 + n_json :]
        assert len(self.binary) == n_binary
        self.material = self.content["materials"][0]

    def view(self, index: int) -> bytes:
        view = self.content["bufferViews"][index]
        return self.binary[view["byteOffset"] : view["byteOffset"] + view["byteLength"]]

    def array(self, index: int) -> np.ndarray:
        accessor = self.content["accessors"][index]
        kind = {5126: "<f4", 5125: "<u4"}[accessor["componentType"]]
        return np.frombuffer(self.view(accessor["bufferView"]), kind).reshape(accessor["count"], -1)

    def attribute(self, name: str) -> np.ndarray:
        return self.array(self.content["meshes"][0]["primitives"][0]["attributes"][name])

    def picture(self, texture: dict[str, int]) -> np.ndarray:
        image = self.content["images"][self.content["textures"][texture["index"]]["source"]]
        read = cv2.imdecode(np.frombuffer(self.view(image["bufferView"]), np.uint8), cv2.IMREAD_UNCHANGED)
        return np.concatenate([read[..., 2::-1], read[..., 3:]], axis=-1) / 255.0

    def surface(self) -> Surface:
        base, more = self.material["pbrMetallicRoughness"], self.material["extensions"]
        rough = self.picture(base["metallicRoughnessTexture"])
        f0 = ((more["KHR_materials_ior"]["ior"] - 1.0) / (more["KHR_materials_ior"]["ior"] + 1.0)) ** 2
        f0 = f0 * linear_from_srgb(self.picture(more["KHR_materials_specular"]["specularColorTexture"])[..., 0])
        coat = self.picture(more["KHR_materials_clearcoat"]["clearcoatTexture"])
        color = linear_from_srgb(self.picture(base["baseColorTexture"])[..., :3])
        return Surface(color, f0, rough[..., 1], rough[..., 2], coat[..., 0], coat[..., 1])

    def normals(self) -> np.ndarray:
        t = 2.0 * self.picture(self.material["normalTexture"])[..., :3] - 1.0
        t = t / np.linalg.norm(t, axis=-1, keepdims=True)
        normal, tangent = self.attribute("NORMAL")[0], self.attribute("TANGENT")[0]
        bitangent = np.cross(normal, tangent[:3]) * tangent[3]
        return t[..., :1] * tangent[:3] + t[..., 1:2] * bitangent + t[..., 2:] * normal


@pytest.mark.parametrize("light_deg", [0.0, 20.0, 40.0])
def test_a_picture_of_the_gltf_file_is_the_render(result: Result, glb: Path, light_deg: float):
    read = Glb(glb)
    camera, light = position(0.0, (SIDE_MM, SIDE_MM)), position(light_deg, (SIDE_MM, SIDE_MM))
    expected = result.render(camera, light)
    picture = gltf_picture(read.surface(), read.normals(), result.grid.points(), camera, light)
    assert psnr(expected, picture) > 38.0
    flipped = gltf_picture(read.surface(), read.normals() * [1.0, -1.0, 1.0], result.grid.points(), camera, light)
    assert psnr(expected, flipped) < 33.0


@pytest.mark.parametrize("name", ["glb", "mesh"])
def test_gltf_has_its_true_size_in_metres(name: str, request: pytest.FixtureRequest):
    read = Glb(request.getfixturevalue(name))
    points, uv = read.attribute("POSITION").astype(np.float64), read.attribute("TEXCOORD_0")
    np.testing.assert_allclose(np.ptp(points[:, :2], axis=0), 1e-3 * SIDE_MM, rtol=1e-6)
    np.testing.assert_allclose(uv[:, 0], points[:, 0] / (1e-3 * SIDE_MM) + 0.5, atol=1e-6)
    np.testing.assert_allclose(uv[:, 1], 0.5 - points[:, 1] / (1e-3 * SIDE_MM), atol=1e-6)
    limits = read.content["accessors"][0]
    np.testing.assert_allclose([limits["min"], limits["max"]], [points.min(axis=0), points.max(axis=0)], rtol=1e-6)


def test_a_mesh_follows_the_heights_and_faces_up(result: Result, mesh: Path):
    read = Glb(mesh)
    points = 1e3 * read.attribute("POSITION").astype(np.float64)
    assert len(points) == 81 * 81
    # Vertices lie on the edges of pixels and in their middles; here in the middle of the pixel in row 10, column 20.
    grid = result.grid.points()
    (at,) = np.flatnonzero(np.all(np.abs(points[:, :2] - grid[10, 20, :2]) < 1e-4, axis=1))
    assert points[at, 2] == pytest.approx(result.depth[10, 20] - np.nanmean(result.depth), abs=1e-5)
    triangles = read.array(read.content["meshes"][0]["primitives"][0]["indices"]).reshape(-1, 3)
    assert len(triangles) == 2 * 80 * 80
    a, b, c = (points[triangles[:, k]] for k in range(3))
    assert np.cross(b - a, c - a)[:, 2].min() > 0.0


def test_pixels_that_are_not_solved_are_holes(glb: Path):
    read = Glb(glb)
    alpha = read.picture(read.material["pbrMetallicRoughness"]["baseColorTexture"])[..., 3]
    assert np.flatnonzero(alpha.ravel() == 0.0).tolist() == [0, 1, 41]
    assert read.material["alphaMode"] == "MASK"


def test_gltf_says_how_true_it_is(glb: Path):
    told = Glb(glb).content["asset"]["extras"]["halfangle"]
    assert told["size_mm"] == pytest.approx([SIDE_MM, SIDE_MM], rel=1e-6)
    assert min(error["psnr_db"] for error in told["errors"][:3]) > 38.0


@pytest.mark.parametrize("name", ["glb", "mesh"])
def test_khronos_validator_finds_nothing(name: str, request: pytest.FixtureRequest):
    node = shutil.which("node")
    if (
        node is None
        or subprocess.run([node, "-e", "require('gltf-validator')"], capture_output=True, check=False).returncode
    ):
        pytest.skip("npm's gltf-validator is not installed where node finds it (NODE_PATH)")
    path = request.getfixturevalue(name)
    told = subprocess.run([node, "-e", VALIDATE, path], capture_output=True, text=True, check=True)
    issues = json.loads(told.stdout)
    assert issues["numErrors"] == issues["numWarnings"] == 0, issues["messages"]


def test_gltf_wants_its_own_ending(result: Result, tmp_path: Path):
    with pytest.raises(InvalidInputError, match=r"written as one file that ends in \.glb"):
        exported(result, tmp_path / "area", "gltf")
    assert list(tmp_path.iterdir()) == []


def test_materialx_is_valid_and_makes_shaders(result: Result, tmp_path: Path):
    folder = exported(result, tmp_path / "area", "materialx")
    files = {node.get("value") for node in ET.parse(folder / "area.mtlx").iter("input") if node.get("name") == "file"}
    assert {file for file in files if not (folder / file).exists()} == set()
    mx = pytest.importorskip("MaterialX")
    from MaterialX import PyMaterialXGenGlsl, PyMaterialXGenShader  # noqa: PLC0415

    library, document = mx.createDocument(), mx.createDocument()
    search = mx.getDefaultDataSearchPath()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), search, library)
    mx.readFromXmlFile(document, str(folder / "area.mtlx"))
    document.setDataLibrary(library)
    assert document.validate() == (True, "")
    for name in ("open_pbr", "standard"):
        node = document.getNode(name)
        definition = node.getNodeDef()
        assert [i.getName() for i in node.getInputs() if definition.getActiveInput(i.getName()) is None] == []
        generator = PyMaterialXGenGlsl.GlslShaderGenerator.create()
        context = PyMaterialXGenShader.GenContext(generator)
        context.registerSourceCodeSearchPath(search)
        assert "main" in generator.generate(name, node, context).getSourceCode("pixel")


def test_usd_is_valid_and_of_true_size(result: Result, tmp_path: Path):
    folder = exported(result, tmp_path / "area", "usd")
    text = (folder / "area.usda").read_text()
    files = [part.split("@")[0] for part in text.split("@./")[1:]]
    assert [file for file in files if not (folder / file).exists()] == []
    pytest.importorskip("pxr")
    from pxr import Usd, UsdGeom, UsdValidation  # noqa: PLC0415

    stage = Usd.Stage.Open(str(folder / "area.usda"))
    assert UsdGeom.GetStageMetersPerUnit(stage) == 0.001
    (plane,) = (prim for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    points = np.array(UsdGeom.Mesh(plane).GetPointsAttr().Get())
    np.testing.assert_allclose(np.ptp(points, axis=0), [SIDE_MM, SIDE_MM, 0.0], rtol=1e-6)
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    assert validators
    found = UsdValidation.ValidationContext(validators).Validate(stage)
    assert [error.GetErrorAsString() for error in found] == []


def test_materials_come_back_from_merls_tables(result: Result, tmp_path: Path):
    folder = exported(result, tmp_path / "area", "merl", resolution=10)
    assert len(list(folder.glob("*.binary"))) == 5
    read = read_merl(folder / f"area_material{GOLD:02d}.binary")
    theta_h, theta_d, phi_d = cell_angles()
    cosines, above = cosines_from_angles(theta_h[:, None, None], theta_d[:, None], phi_d)
    np.testing.assert_array_equal(read.measured[0], above)
    level = np.median(result.fits.coefficient[material_map().ravel() == GOLD, 0, 0])
    for channel, atom in enumerate(atoms()[3 * GOLD : 3 * GOLD + 3]):
        expected = level * atom.evaluate(cosines)[above]
        np.testing.assert_allclose(read.stored[channel][above] * SCALES[channel], expected, rtol=1e-6)


def test_merl_wants_a_palette(result: Result, tmp_path: Path):
    without = replace(result, fits=replace(result.fits, dictionary=parametric()))
    with pytest.raises(InvalidInputError, match="has no palette, whose materials are written"):
        exported(without, tmp_path / "area", "merl")


@pytest.mark.slow
def test_mitsuba_makes_the_same_picture(result: Result, tmp_path: Path):
    mi = pytest.importorskip("mitsuba")
    mi.set_variant("llvm_ad_rgb")
    folder = exported(result, tmp_path / "area", "mitsuba")
    scene = ET.parse(folder / "area.xml")
    distance = float(scene.find("sensor/transform/lookat").get("origin").split(",")[2])
    camera = np.array([0.0, 0.0, distance])
    for texture in scene.iter("texture"):
        # A picture of 40 pixels is blurred otherwise.
        ET.SubElement(texture, "string", name="filter_type", value="nearest")
    for angle in (0.0, 20.0, 40.0):
        light = position(angle, (SIDE_MM, SIDE_MM))
        for axis, value in zip("xyz", light, strict=True):
            scene.find("emitter/point").set(axis, str(value))
        scene.write(folder / "moved.xml")
        picture = np.array(mi.render(mi.load_file(str(folder / "moved.xml")), spp=64))
        expected = result.render(camera, light) * 3.0 * distance**2
        # Its clear coat is another one: that quarter is left out.
        expected[SIZE // 2 :, SIZE // 2 :] = np.nan
        assert psnr(expected, picture) > 33.0
        assert psnr(expected, picture[::-1]) < 25.0
        assert psnr(expected, picture[:, ::-1]) < 25.0


@pytest.mark.parametrize("target", ["materialx", "usd", "mitsuba", "merl"])
def test_the_readme_names_what_stands_beside_the_maps(result: Result, tmp_path: Path, target: Target):
    folder = exported(result, tmp_path / "area", target, resolution=10)
    page = (folder / "README.md").read_text()
    unnamed = [path.name for path in folder.iterdir() if not ({f"`{path.name}`", f"`{path.stem}`"} & set(page.split()))]
    assert sorted(unnamed) == ["README.md"]
