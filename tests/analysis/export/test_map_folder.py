"""Folders of maps, read again as another program reads them."""

from __future__ import annotations

import errno
import json
import struct
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import OpenEXR
import pytest

from analysis.export.comparison import position
from analysis.export.export import export_result
from analysis.export.options import ExportOptions
from analysis.export.record import record_text
from analysis.results.result import Result
from instrument.files.validation import InvalidInputError
from instrument.files.whole_file import NotWrittenError
from instrument.pictures.srgb import linear_from_srgb
from tests.analysis.export.gltf_shading import Surface, gltf_picture, psnr
from tests.analysis.export.scene import PITCH, SIZE, small_result

WHITE = ExportOptions(white_reflectance=1.0)

LIGHTS_DEG = (0.0, 20.0, 40.0)


@pytest.fixture(scope="module")
def result() -> Result:
    return small_result()


@pytest.fixture(scope="module")
def folder(result: Result, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("export") / "area"
    export_result(result, made, WHITE, "area.result.h5")
    return made


def read_png(path: Path) -> np.ndarray:
    """Return a PNG as numbers 0 to 1, RGB."""
    read = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    assert read.dtype == np.uint16
    return (read if read.ndim == 2 else read[..., ::-1]) / 65535.0


def read_exr(path: Path) -> dict[str, np.ndarray]:
    with OpenEXR.File(str(path)) as file:
        return {name: channel.pixels for name, channel in file.channels().items()}


def surface_of(folder: Path) -> Surface:
    def of(name: str) -> np.ndarray:
        path = folder / f"{folder.name}_{name}.png"
        return read_png(path) if path.exists() else np.zeros((SIZE, SIZE))

    names = ("Roughness", "Metalness", "Clearcoat", "ClearcoatRoughness")
    return Surface(linear_from_srgb(of("Color")), 0.08 * of("Specular"), *map(of, names))


def normals_of(folder: Path, name: str = "NormalGL") -> np.ndarray:
    normals = 2.0 * read_png(folder / f"{folder.name}_{name}.png") - 1.0
    return normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def pictures(result: Result, surface: Surface, normals: np.ndarray) -> list[float]:
    """Return how alike pictures of maps are to the project's own, dB, at each of the lights."""
    size = (SIZE * PITCH, SIZE * PITCH)
    points = result.grid.points(np.nan_to_num(result.depth))
    alike = []
    for angle in LIGHTS_DEG:
        camera, light = position(0.0, size), position(angle, size)
        alike.append(psnr(result.render(camera, light), gltf_picture(surface, normals, points, camera, light)))
    return alike


def test_pictures_of_the_maps_by_gltf_are_the_render(result: Result, folder: Path):
    assert min(pictures(result, surface_of(folder), normals_of(folder))) > 40.0


def test_wrong_normals_are_seen(result: Result, folder: Path):
    surface, normals = surface_of(folder), normals_of(folder)
    flat = np.broadcast_to([0.0, 0.0, 1.0], normals.shape)
    for wrong in (normals * [1.0, -1.0, 1.0], normals * [-1.0, 1.0, 1.0], flat, normals_of(folder, "NormalDX")):
        assert pictures(result, surface, wrong)[-1] < 33.0


def test_the_figures_are_measured_on_what_was_written(result: Result, folder: Path):
    told = json.loads((folder / "export.json").read_text())
    errors = {(e["camera_deg"], e["light_deg"]): e["psnr_db"] for e in told["errors"]}
    measured = pictures(result, surface_of(folder), normals_of(folder))
    assert [errors[0.0, angle] for angle in LIGHTS_DEG] == pytest.approx(measured, abs=0.3)
    assert all(error["delta_e"] < 1.0 for error in told["errors"])
    assert told["counts"]["n_unsolved"] == 3
    assert told["counts"]["n_outside_palette"] == 1
    assert told["scale"] == {"factor": 1.0, "reason": "reflectance of white as given"}


def test_normals_survive_sixteen_bits(result: Result, folder: Path):
    known = np.isfinite(result.normals[..., 0])
    cosine = np.sum(normals_of(folder)[known] * result.normals[known], axis=-1)
    assert np.rad2deg(np.arccos(np.clip(cosine, -1.0, 1.0))).max() < 0.01
    exact = read_exr(folder / "area_NormalGL.exr")["RGB"]
    np.testing.assert_allclose(exact[known], result.normals[known], atol=1e-6)


def test_green_points_up_in_gl_and_down_in_dx(result: Result, folder: Path):
    gl, dx = (read_png(folder / f"area_{name}.png") for name in ("NormalGL", "NormalDX"))
    np.testing.assert_allclose(gl[..., 1], 1.0 - dx[..., 1], atol=2e-5)
    row, column = np.unravel_index(np.nanargmax(result.normals[..., 1]), result.depth.shape)
    assert gl[row, column, 1] > 0.5
    # Where the normal leans up, the surface falls from one row to the one above it.
    assert result.depth[row - 1, column] < result.depth[row + 1, column]


def test_size_is_true(folder: Path):
    told = json.loads((folder / "export.json").read_text())
    assert told["size_mm"] == pytest.approx([SIZE * PITCH, SIZE * PITCH], rel=1e-6)
    data = (folder / "area_Color.png").read_bytes()
    at = data.index(b"pHYs") + 4
    assert struct.unpack(">IIB", data[at : at + 9]) == (4000, 4000, 1)


def test_height_is_told_in_mm_and_about_the_mean_plane(result: Result, folder: Path):
    told = json.loads((folder / "export.json").read_text())["displacement"]
    known = np.isfinite(result.depth)
    height = result.depth - np.nanmean(result.depth)
    exact = read_exr(folder / "area_Displacement.exr")["Y"]
    np.testing.assert_allclose(exact[known], height[known], atol=1e-6)
    coded = (2.0 * read_png(folder / "area_Displacement.png") - 1.0) * told["range_mm"]
    np.testing.assert_allclose(coded[known], height[known], atol=told["range_mm"] / 65000)


def test_pixels_that_are_not_solved_say_so(folder: Path):
    assert np.flatnonzero(read_png(folder / "area_Mask.png").ravel() == 0.0).tolist() == [0, 1, 41]
    sigma = read_exr(folder / "area_NormalSigma.exr")["Y"].ravel()
    assert np.flatnonzero(np.isnan(sigma)).tolist() == [0, 1, 41]
    assert sigma[2] == pytest.approx(0.2, abs=1e-4)


def test_colour_is_linear_in_exr_and_srgb_in_png(folder: Path):
    linear = read_exr(folder / "area_Color.exr")["RGB"]
    np.testing.assert_allclose(linear_from_srgb(read_png(folder / "area_Color.png")), linear, atol=2e-4)


def test_weights_of_materials_have_a_channel_each(folder: Path):
    weights = read_exr(folder / "area_MaterialWeights.exr")
    assert sorted(weights) == [f"material{k:02d}" for k in range(5)]
    total = sum(weights.values())
    assert np.count_nonzero(np.abs(total - 1.0) > 1e-5) == 1


def test_the_readme_names_every_map(folder: Path):
    page = (folder / "README.md").read_text()
    for path in folder.glob("*.exr"):
        assert f"`{path.stem}`" in page
    assert {path.stem for path in folder.glob("*.png")} < {path.stem for path in folder.glob("*.exr")}


def test_one_kind_of_normals_is_enough_for_some(result: Result, tmp_path: Path):
    export_result(result, tmp_path / "unreal", ExportOptions(normals="directx", white_reflectance=1.0, resolution=10))
    assert (tmp_path / "unreal/unreal_NormalDX.png").exists()
    assert not (tmp_path / "unreal/unreal_NormalGL.png").exists()


def test_a_result_without_depth_is_flat_and_says_so(result: Result, tmp_path: Path):
    without = replace(result, depth=np.full_like(result.depth, np.nan))
    record = export_result(without, tmp_path / "flat", WHITE)
    assert "heights     none: the result has no depth" in record_text(record)
    assert not read_exr(tmp_path / "flat/flat_Displacement.exr")["Y"].any()
    with pytest.raises(InvalidInputError, match="--mesh: needs heights, and the result has no depth"):
        export_result(without, tmp_path / "flat.glb", ExportOptions(target="gltf", mesh=9))


def test_one_channel_makes_grey_maps(result: Result, tmp_path: Path):
    fits = replace(result.fits, atom=result.fits.atom[:, :1], coefficient=result.fits.coefficient[:, :1])
    fits = replace(fits, dictionary=replace(fits.dictionary, name="parametric"))
    grey = export_result(replace(result, fits=fits), tmp_path / "grey", ExportOptions(white_reflectance=1.0))
    color = grey.prepared.maps.surfaces.base_color
    np.testing.assert_array_equal(color[:, 0], color[:, 2])
    assert grey.errors[0].psnr_db > 35.0


def test_names_that_a_format_would_take_for_its_own_are_made_harmless(result: Result, tmp_path: Path):
    export_result(result, tmp_path / "a {b}@c", ExportOptions(target="usd", white_reflectance=1.0, resolution=10))
    assert (tmp_path / "a {b}@c/a__b__c_Color.png").exists()
    assert "@./a__b__c_Color.png@" in (tmp_path / "a {b}@c/a__b__c.usda").read_text()


def test_nothing_is_left_of_an_export_that_fails(result: Result, tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    def full(*_: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("analysis.export.map_folder.write_exr", full)
    with pytest.raises(NotWrittenError, match=r"maps_Color\.exr is not written: disk full"):
        export_result(result, tmp_path / "maps", WHITE)
    assert list(tmp_path.iterdir()) == []
