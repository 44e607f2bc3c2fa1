import numpy as np
import pytest

from drivers.simulated.settings import SCENE_NAMES
from drivers.simulated.world import World
from tests.drivers.rigs import small_rig

each_scene = pytest.mark.parametrize("scene", SCENE_NAMES)


@pytest.fixture(scope="module")
def worlds() -> dict[str, World]:
    return {name: World.from_rig(small_rig(scene=name)) for name in SCENE_NAMES}


def area() -> tuple[np.ndarray, np.ndarray]:
    axis = np.linspace(-30.0, 30.0, 201)
    x, y = np.meshgrid(axis, axis[::-1])
    return x, y


@each_scene
def test_normals_agree_with_differences_of_depth(worlds: dict[str, World], scene: str):
    (x, y), world, h = area(), worlds[scene], 1e-4
    z_x = (world.truth(x + h, y).depth - world.truth(x - h, y).depth) / (2.0 * h)
    z_y = (world.truth(x, y + h).depth - world.truth(x, y - h).depth) / (2.0 * h)
    normals = world.truth(x, y).normals
    np.testing.assert_allclose(-normals[..., 0] / normals[..., 2], z_x, atol=1e-6)
    np.testing.assert_allclose(-normals[..., 1] / normals[..., 2], z_y, atol=1e-6)


@each_scene
def test_normals_have_unit_length_and_point_out(worlds: dict[str, World], scene: str):
    normals = worlds[scene].truth(*area()).normals
    np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0)
    assert np.all(normals[..., 2] > 0.8)


def test_the_relief_is_near_planar(worlds: dict[str, World]):
    truth = worlds["relief"].truth(*area())
    slope_deg = np.degrees(np.arccos(truth.normals[..., 2]))
    assert 0.4 < np.abs(truth.depth).max() < 0.8
    assert np.percentile(slope_deg, 99.0) < 25.0
    assert np.median(slope_deg) > 2.0


@each_scene
def test_the_insert_goes_over_into_the_plate(worlds: dict[str, World], scene: str):
    border = np.linspace(-32.0, 32.0, 101)
    for x, y in ((border, 32.0), (border, -32.0), (32.0, border), (-32.0, border)):
        np.testing.assert_allclose(worlds[scene].truth(x, y).depth, 0.0, atol=1e-6)


def test_the_letter_f_is_not_mirrored(worlds: dict[str, World]):
    def height(x: float, y: float) -> float:
        return float(worlds["relief"].truth(x, y).depth)

    assert height(7.2, 6.0) - height(14.0, 6.0) > 0.3  # the stem is on the left
    assert height(18.0, 22.5) - height(18.0, 7.0) > 0.3  # the upper arm reaches far to the right
    assert height(19.0, 22.5) - height(20.5, 13.0) > 0.3  # further than the middle one


def test_a_patchwork_has_five_materials_with_soft_borders(worlds: dict[str, World]):
    truth = worlds["relief"].truth(*area())
    assert len(truth.material_names) == 6
    assert np.all(np.bincount(truth.material.ravel(), minlength=6)[:5] > 500)
    np.testing.assert_allclose(truth.material_shares.sum(axis=-1), 1.0)
    assert np.any(np.abs(truth.material_shares[..., 3] - 0.5) < 0.2)


def test_a_smaller_area_keeps_its_slopes():
    rig = small_rig(scene="relief")
    rig["geometry"]["area_mm"] = [28.0, 28.0]
    x, y = area()
    small = World.from_rig(rig).truth(x * 14.0 / 30.0, y * 14.0 / 30.0)
    assert 10.0 < np.degrees(np.arccos(small.normals[..., 2])).max() < 40.0


def test_an_unknown_scene_is_refused_with_the_names_that_exist():
    with pytest.raises(ValueError, match="'moon'; allowed are relief, plane, sphere_cap"):
        World.from_rig(small_rig(scene="moon"))


def test_an_unknown_key_is_refused_with_the_names_that_exist():
    with pytest.raises(ValueError, match=r"no key gravity; allowed are seed, scene"):
        World.from_rig(small_rig(gravity=9.81))
