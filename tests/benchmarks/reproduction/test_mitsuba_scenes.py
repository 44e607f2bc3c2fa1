"""Scenes for Mitsuba: what is written is what is true, and what is rendered stands where our frames say."""

from __future__ import annotations

from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import OpenEXR
import pytest
from PIL import Image

from analysis.camera.board_pattern import pattern
from analysis.evaluation.metrics import angular_error_deg
from analysis.registration.grid import Grid
from benchmarks.reproduction.experiment import Request, SkippedError
from benchmarks.reproduction.experiments import synthetic
from benchmarks.reproduction.mitsuba_scenes import render as rendering
from benchmarks.reproduction.mitsuba_scenes.chain import capture_text
from benchmarks.reproduction.mitsuba_scenes.figures import MAX_BYTES, grid_of, save, show
from benchmarks.reproduction.mitsuba_scenes.files import INTENSITY, SCENE_FILE, Rendering, relief_mesh, write_scene
from benchmarks.reproduction.mitsuba_scenes.plate import AREA_MM, HALF_PLATE_MM, boards, print_on_plate
from benchmarks.reproduction.mitsuba_scenes.prepared import truth_as_seen, truth_on
from benchmarks.reproduction.mitsuba_scenes.render import JOB_FILE, LIBRARY_VARIABLE, RenderError, missing, render
from benchmarks.reproduction.mitsuba_scenes.scenes import LEAF, MEDAL, SCENES, Scene
from benchmarks.reproduction.mitsuba_scenes.surfaces import HALF_WIDTH_MM
from benchmarks.reproduction.mitsuba_scenes.views import LIGHT_OFFSET_MM, Camera, captured, novel
from drivers.simulated.geometry import camera_from_lab, stage_rotation
from instrument.config.capture_config import load_capture
from instrument.config.loading import load_protocol
from protocols.planning.plan import stated_poses

SMALL = Rendering(Camera(96, 72), samples=8, mesh_pitch_mm=1.0)
BY_NAME = pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene.name)


@BY_NAME
def test_a_scene_names_only_files_that_stand_beside_it(scene: Scene, tmp_path: Path) -> None:
    write_scene(tmp_path, scene, SMALL)
    names = [e.get("value") for e in ET.parse(tmp_path / SCENE_FILE).iter() if e.get("name") == "filename"]
    assert len(names) == 3 + len(scene.textures(np.zeros((1, 1)), np.zeros((1, 1))))
    assert all((tmp_path / str(name)).is_file() for name in names)


@BY_NAME
def test_the_normals_of_the_mesh_are_those_of_its_triangles_the_more_so_the_finer_it_is(scene: Scene) -> None:
    coarse, fine = (_bend(scene, pitch) for pitch in (0.4, 0.2))
    assert coarse < 4.0
    assert fine == pytest.approx(coarse / 2, rel=0.2)


def _bend(scene: Scene, pitch: float) -> float:
    """Return the mean angle between triangles and the normals at their corners, deg."""
    vertices, normals, _, faces = relief_mesh(scene.surface, pitch)
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    flat = np.cross(b - a, c - a)
    flat /= np.linalg.norm(flat, axis=1, keepdims=True)
    return float(np.mean([angular_error_deg(flat, normals[faces[:, k]]) for k in range(3)]))


@BY_NAME
def test_the_relief_meets_the_plate_without_a_step_or_an_edge(scene: Scene) -> None:
    along = np.linspace(-HALF_WIDTH_MM, HALF_WIDTH_MM, 200)
    for x, y in ((along, HALF_WIDTH_MM), (along, -HALF_WIDTH_MM), (HALF_WIDTH_MM, along), (-HALF_WIDTH_MM, along)):
        assert np.all(scene.surface.height(np.asarray(x), np.asarray(y)) == 0.0)
        np.testing.assert_allclose(scene.surface.normals(np.asarray(x), np.asarray(y))[..., 2], 1.0)


def test_the_truth_of_a_pixel_is_that_of_the_place_that_the_conventions_give_it() -> None:
    grid = Grid(12, 16, 2.0)
    truth = truth_on(LEAF, grid)
    x, y = (13 - 7.5) * 2.0, (5.5 - 2) * 2.0
    assert truth.depth[2, 13] == pytest.approx(float(LEAF.surface.height(np.array(x), np.array(y))))


def test_averaging_over_a_pixel_moves_the_truth_less_the_finer_maps_and_pictures_are() -> None:
    moved = [
        np.mean(angular_error_deg(truth_as_seen(LEAF, grid, camera), truth_on(LEAF, grid).normals))
        for grid, camera in (
            (Grid(44, 44, 0.8), Camera(640, 480)),
            (Grid(88, 88, 0.4), Camera(640, 480)),
            (Grid(88, 88, 0.2), Camera(1280, 960)),
        )
    ]
    assert moved[2] < 0.5 * moved[1] < 0.5 * moved[0]


def test_mitsubas_camera_sees_a_point_where_our_projection_puts_it() -> None:
    """Mitsuba's camera looks along z, with y up and so x to the left."""
    camera, points = Camera(640, 480), np.array([[10.0, 4.0, 1.0], [-20.0, 15.0, 0.0], [0.0, 0.0, 0.0]])
    for placement in (*captured()[::9], *novel()):
        to_camera = np.linalg.inv(placement.to_world)
        x, y, z = to_camera[:3, :3] @ points.T + to_camera[:3, 3:]
        across = 0.5 * camera.width / np.tan(np.deg2rad(camera.field_of_view_deg) / 2)
        pixels = np.stack([(camera.width - 1) / 2 - across * x / z, (camera.height - 1) / 2 - across * y / z], axis=1)
        np.testing.assert_allclose(placement.view(camera).project(points), pixels, atol=1e-9)
        assert np.linalg.det(placement.to_world) == pytest.approx(1.0)


def test_the_views_are_the_poses_of_the_protocol_on_the_stage_of_the_simulated_rig() -> None:
    poses = stated_poses(load_protocol(Path("examples/hdr_sweep.toml")))
    assert len(captured()) == len(poses) == 65
    for pose, placement in zip(poses, captured(), strict=True):
        expected = camera_from_lab(350.0) @ stage_rotation(pose["tilt"], pose["turn"])
        np.testing.assert_allclose(placement.rotation, expected[:3, :3], atol=1e-12)
        np.testing.assert_allclose(-placement.rotation @ placement.camera, expected[:3, 3], atol=1e-9)
        np.testing.assert_allclose(placement.rotation @ (placement.light - placement.camera), LIGHT_OFFSET_MM)


def test_the_boards_are_printed_where_the_capture_says_and_clear_of_the_area() -> None:
    plate = print_on_plate() > 127
    per_mm = plate.shape[0] / (2 * HALF_PLATE_MM)
    for board in boards():
        left, top = board.corner_mm
        side = board.square_mm * board.squares[0]
        assert min(max(abs(left), abs(left + side)), max(abs(top), abs(top - side))) > AREA_MM / 2
        row, column, n = (round(d * per_mm) for d in (HALF_PLATE_MM - top, HALF_PLATE_MM + left, side))
        reference = pattern(board, round(board.square_mm * per_mm)) > 0.5
        np.testing.assert_array_equal(plate[row : row + n, column : column + n], reference)


def test_a_capture_states_the_boards_and_what_a_ruler_says(tmp_path: Path) -> None:
    (tmp_path / "capture.toml").write_text(capture_text(Camera(640, 480), 65, 0.5))
    capture = load_capture(tmp_path / "capture.toml")
    assert tuple(board.corner_mm for board in capture.boards) == tuple(board.corner_mm for board in boards())
    assert capture.light is not None
    assert capture.light.offset_mm != LIGHT_OFFSET_MM
    assert capture.intrinsics is None
    assert len(capture.poses) == 65


def test_without_mitsuba_the_experiment_is_skipped_and_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rendering.importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SkippedError, match=r"pip install 'halfangle\[validate\]'.*libllvm19"):
        synthetic.run(Request(tmp_path, quick=True, seed=0))
    assert not list(tmp_path.rglob("*.xml"))


def test_a_library_that_is_not_there_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rendering.importlib.util, "find_spec", lambda name: True)
    monkeypatch.setenv(LIBRARY_VARIABLE, "/nowhere/libLLVM.so")
    assert "/nowhere/libLLVM.so" in (missing() or "")


def test_what_was_rendered_is_kept_for_the_same_seed_only(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    calls = []

    def run(folder: Path) -> None:
        calls.append(sorted(path.name for path in folder.glob("view-*.exr")))
        for i in range(2):
            (folder / f"view-{i:03d}.exr").touch()

    monkeypatch.setattr(rendering, "missing", lambda: None)
    monkeypatch.setattr(rendering, "_run", run)
    views = captured()[:2]
    files = render(tmp_path, MEDAL, SMALL, views, seed=1)
    assert render(tmp_path, MEDAL, SMALL, views, seed=1) == files
    files[1].unlink()
    render(tmp_path, MEDAL, SMALL, views, seed=1)
    render(tmp_path, MEDAL, SMALL, views, seed=2)
    assert calls == [[], ["view-000.exr"], []]


def test_a_renderer_that_dies_is_an_error_with_its_last_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    dying = tmp_path / "dying"
    dying.write_text("#!/bin/sh\necho LLVM API is too old\nkill -ABRT $$\n")
    dying.chmod(0o755)
    monkeypatch.setattr(rendering, "missing", lambda: None)
    monkeypatch.setattr(rendering.sys, "executable", str(dying))
    with pytest.raises(RenderError, match=r"ended with -6 .* LLVM API is too old"):
        render(tmp_path / "scene", MEDAL, SMALL, captured()[:1], seed=1)


@pytest.mark.parametrize(("detail", "mode"), [(1.0, "RGB"), (60.0, "P")])
def test_a_figure_keeps_all_its_colours_unless_it_would_be_too_large(tmp_path: Path, detail: float, mode: str) -> None:
    x, y = np.meshgrid(*[np.linspace(0.0, detail, 300)] * 2)
    image = 0.5 + 0.5 * np.stack([np.sin(x * y), np.cos(3.0 * x), np.sin(2.0 * y + x * x)], axis=-1)
    figure, axes = grid_of(2, 2)
    for ax in axes.flat:
        show(ax, image, "")
    path = save(figure, tmp_path / "figure.png")
    assert path.stat().st_size <= MAX_BYTES
    with Image.open(path) as picture:
        assert picture.mode == mode


@pytest.fixture(scope="module")
def rendered(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    if what := missing():
        pytest.skip(what)
    folder = tmp_path_factory.mktemp("rendered")
    files = render(folder, MEDAL, SMALL, [captured()[0], captured()[20]], seed=3)
    assert (folder / JOB_FILE).exists()
    return files


@pytest.mark.parametrize("number", [0, 1])
def test_mitsuba_puts_ink_and_paper_where_our_frames_do(rendered: list[Path], number: int) -> None:
    placement = captured()[(0, 20)[number]]
    with OpenEXR.File(str(rendered[number])) as file:
        picture = file.channels()["RGB"].pixels
    # The squares along a board's diagonal are black all over; between the boards there is paper.
    ink = [
        (board.corner_mm[0] + (k + 0.5) * board.square_mm, board.corner_mm[1] - (k + 0.5) * board.square_mm)
        for board in boards()
        for k in range(board.squares[0])
    ]
    paper = [(0.0, 35.0), (0.0, -35.0), (35.0, 0.0), (-35.0, 0.0)]
    levels = []
    for places in (ink, paper):
        points = np.array([(x, y, 0.0) for x, y in places])
        column, row = np.rint(placement.view(SMALL.camera).project(points)).astype(int).T
        inside = (row >= 0) & (row < SMALL.camera.height) & (column >= 0) & (column < SMALL.camera.width)
        levels.append(picture[row[inside], column[inside], 1] / _lambertian(points[inside], placement.light))
    assert levels[0].max() < 0.1
    assert 0.75 < levels[1].min() < levels[1].max() < 0.85


def _lambertian(points: np.ndarray, light: np.ndarray) -> np.ndarray:
    """Return the radiance of an albedo of 1 on the plate."""
    to_light = light - points
    return INTENSITY / np.pi * to_light[:, 2] / np.linalg.norm(to_light, axis=1) ** 3


@pytest.mark.slow
def test_the_chain_finds_the_normals_of_a_scene_that_mitsuba_rendered(tmp_path: Path) -> None:
    if what := missing():
        pytest.skip(what)
    finding = synthetic.run(Request(tmp_path, quick=True, seed=5))
    by_stage = {row["stage"]: row for row in finding.rows}
    assert by_stage["normal"]["normals_mean_deg"] < 0.4
    assert by_stage["normal"]["novel_1_psnr_db"] > 30.0
    assert all(path.stat().st_size < 200_000 for path in finding.figures)
