import cv2
import numpy as np
import pytest

from drivers.simulated.rendering.boards import charuco_board, corners_mm, draw_boards, ink_at
from drivers.simulated.world import World
from tests.drivers.rigs import small_rig
from tests.drivers.simulated.test_render import project


@pytest.fixture(scope="module")
def world() -> World:
    return World.from_rig(small_rig(960, 720, scene="plane", light_offset_mm=[12.6, -1.1, 0.4]))


@pytest.mark.parametrize("position", [(0.0, 0.0), (30.0, 70.0), (-45.0, 200.0)])
def test_corners_land_where_the_true_pose_puts_them(world: World, position: tuple[float, float]):
    place = dict(zip(("tilt", "turn"), position, strict=True))
    picture = world.picture(place).mean(axis=-1)
    grey = np.clip(200.0 * picture / np.percentile(picture, 95.0), 0.0, 255.0).astype(np.uint8)
    errors = []
    for board in world.bench.boards:
        found, ids, _, _ = cv2.aruco.CharucoDetector(charuco_board(board)).detectBoard(grey)
        if ids is not None:
            expected = project(world, corners_mm(board)[ids.ravel()], place)
            errors += list(found.reshape(-1, 2) - expected)
    assert len(errors) >= 27
    distances = np.linalg.norm(errors, axis=-1)
    # OpenCV's own refinement strays by a few tenths at times, on a perfect picture too.
    assert np.percentile(distances, 90.0) < 0.3
    assert np.median(distances) < 0.1
    assert np.linalg.norm(np.mean(errors, axis=0)) < 0.05


def test_the_print_has_its_edges_where_the_board_says(world: World):
    ink = draw_boards(world.bench.boards, 0.19)
    corner = world.bench.boards[0].corner_mm
    for k in range(1, 4):
        # Along the middle of the quiet zone above a marker, black and white squares take turns.
        edge, y = corner[0] + 5.5 * k, corner[1] - 0.25
        x = np.linspace(edge - 0.5, edge + 0.5, 2001)
        coverage = np.array([ink_at(ink, x_k, y) for x_k in x])
        crossing = x[np.argmin(np.abs(coverage - 0.5))]
        assert crossing == pytest.approx(edge, abs=0.02 * 0.19)


def test_there_is_paper_beyond_the_boards(world: World):
    ink = world.scene.surface.ink
    assert [ink_at(ink, x, y) for x, y in ((0.0, 45.0), (-55.0, 54.5), (45.0, 0.0), (200.0, 0.0))] == [0.0] * 4


def test_a_rig_without_boards_has_no_ink():
    rig = small_rig(scene="plane")
    rig["boards"] = []
    assert np.isfinite(World.from_rig(rig).picture()).all()
