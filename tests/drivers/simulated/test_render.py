import cv2
import numpy as np
import pytest

from drivers.simulated.rendering.heightfield import sample_heights
from drivers.simulated.rendering.rays import first_hit
from drivers.simulated.rendering.scene import Scene
from drivers.simulated.world import World
from tests.drivers.rigs import small_rig

SQUARE = {"mount_rotation_deg": 0.0, "mount_translation_mm": 0.0, "axis_error_deg": 0.0}


def project(world: World, points: np.ndarray, position: dict[str, float]) -> np.ndarray:
    """Return pixels, shape (n, 2), of sample points, shape (n, 3), by OpenCV's own model."""
    pose = world.sample_to_camera(position)
    rotation, _ = cv2.Rodrigues(pose[:3, :3])
    pixels, _ = cv2.projectPoints(points, rotation, pose[:3, 3], world.camera_matrix, world.distortion)
    return pixels.reshape(-1, 2)


def losses(world: World, points: np.ndarray, pixels: np.ndarray, position: dict[str, float]) -> np.ndarray:
    """Return lobe times vignetting, shape (n,), written anew."""
    pose, settings = world.sample_to_camera(position), world.bench.simulation
    to_point = points @ pose[:3, :3].T + pose[:3, 3] - np.array(settings.light_offset_mm)
    lobe = (to_point[:, 2] / np.linalg.norm(to_point, axis=-1)) ** settings.lobe_exponent
    radius = np.linalg.norm(pixels - world.camera_matrix[:2, 2], axis=-1)
    corner = np.hypot(world.bench.width, world.bench.height) / 2.0
    return lobe * (1.0 - settings.vignetting * (radius / corner) ** 2)


@pytest.mark.parametrize("position", [{"tilt": 0.0, "turn": 0.0}, {"tilt": 40.0, "turn": 130.0}])
def test_a_picture_of_a_plane_is_the_closed_form(position: dict[str, float]):
    world = World.from_rig(small_rig(scene="plane", light_offset_mm=[30.0, -9.0, 2.0]))
    # White paper, gold, cloth and teal paint, away from borders; the area at the pixel is what it averages.
    points = np.array([[0.0, 45.0, 0.0], [-14.0, 11.0, 0.0], [-15.0, -14.0, 0.0], [14.0, 12.0, 0.0]])
    pixels = project(world, points, position)
    places = world.camera_in_sample(position), world.light_in_sample(position)
    expected = world.radiance_on_area(points[:, 0], points[:, 1], *places)
    expected *= losses(world, points, pixels, position)[:, None]
    picture = world.picture(position)
    seen = np.stack(
        [cv2.remap(picture[..., c], *pixels.T.astype(np.float32), cv2.INTER_LINEAR).ravel() for c in range(3)]
    )
    np.testing.assert_allclose(seen.T, expected, rtol=0.01)


def test_a_white_plate_reflects_as_lambert_says():
    world = World.from_rig(small_rig(scene="plane"))
    point, camera, light = np.array([0.0, 45.0, 0.0]), np.array([10.0, 0.0, 300.0]), np.array([200.0, 20.0, 250.0])
    to_light = light - point
    d = np.linalg.norm(to_light)
    expected = 0.85 / np.pi * to_light[2] / d**3
    np.testing.assert_allclose(world.radiance_on_area(*point[:2], camera, light), expected, rtol=1e-12)


def test_light_falls_off_with_the_square_of_its_distance():
    world = World.from_rig(small_rig(scene="plane"))
    camera = np.array([0.0, 0.0, 350.0])
    near, far = (world.radiance_on_area(5.0, 5.0, camera, np.array([5.0, 5.0, d])) for d in (100.0, 300.0))
    np.testing.assert_allclose(near, 9.0 * far, rtol=1e-9)


def test_nothing_shines_through_the_sample():
    world = World.from_rig(small_rig(scene="relief"))
    above, below = np.array([0.0, 0.0, 350.0]), np.array([0.0, 0.0, -350.0])
    assert np.all(world.radiance_on_area(5.0, 5.0, above, below) == 0.0)
    assert np.all(world.radiance_on_area(5.0, 5.0, below, above) == 0.0)


def test_camera_and_light_may_change_places_but_for_cosine_and_distance():
    world = World.from_rig(small_rig(scene="plane"))
    a, b, point = np.array([90.0, 20.0, 300.0]), np.array([-60.0, 80.0, 260.0]), np.array([14.0, 12.0, 0.0])

    def reflectance(camera: np.ndarray, light: np.ndarray) -> np.ndarray:
        return world.radiance_on_area(*point[:2], camera, light) * np.linalg.norm(light - point) ** 3 / light[2]

    np.testing.assert_allclose(reflectance(a, b), reflectance(b, a), rtol=1e-9)


def test_the_picture_does_not_depend_on_the_number_of_threads():
    world = World.from_rig(small_rig(scene="relief"))
    position = {"tilt": 30.0, "turn": 15.0}
    np.testing.assert_array_equal(world.picture(position, n_threads=1), world.picture(position, n_threads=3))


def test_the_sample_appears_upright_and_not_mirrored():
    world = World.from_rig(small_rig(scene="relief"))
    left, right, top = project(world, np.array([[-20.0, 0, 0], [20.0, 0, 0], [0, 20.0, 0]]), {"tilt": 0.0, "turn": 0.0})
    assert left[0] < right[0]
    assert top[1] < left[1]


def test_the_turntable_rides_on_the_tilt():
    world = World.from_rig(small_rig(**SQUARE))
    pose = world.sample_to_camera({"tilt": 30.0, "turn": 90.0})
    # The tilt axis is lab x; sample z leans towards lab -y, which is down in the picture.
    np.testing.assert_allclose(pose[:3, 2], [0.0, 0.5, -np.sqrt(0.75)], atol=1e-12)
    np.testing.assert_allclose(pose[:3, 0], [0.0, -np.sqrt(0.75), -0.5], atol=1e-12)
    np.testing.assert_allclose(pose[:3, 3], [0.0, 0.0, 350.0], atol=1e-12)


RIDGE_HEIGHT, RIDGE_HALF = 3.0, 2.0


@pytest.fixture(scope="module")
def ridge() -> World:
    """Return a world with a steep ridge along y, 3 mm high, and the light far to the right."""
    world = World.from_rig(small_rig(scene="plane", light_offset_mm=[350.0, 0.0, 0.0], **SQUARE))
    surface = world.scene.surface

    def height(x: np.ndarray, y: np.ndarray) -> np.ndarray:
        return RIDGE_HEIGHT * np.exp(-((x / RIDGE_HALF) ** 20)) * np.exp(-((y / 25.0) ** 20))

    field = sample_heights(height, (32.0, 32.0), surface.field.pitch)
    assert field.heights.shape == surface.field.heights.shape
    scene = Scene(surface._replace(field=field), world.scene.material_names)
    return World(world.bench, scene, world.clock)


def test_a_ridge_casts_a_shadow_as_long_as_geometry_says(ridge: World):
    light = ridge.light_in_sample({"tilt": 0.0, "turn": 0.0})
    np.testing.assert_allclose(light, [350.0, 0.0, 350.0], atol=1e-9)
    x = np.linspace(-3.0, 3.0, 6001)
    z = ridge.truth(x, 0.0).depth
    # Where the rays past each point of the ridge meet the ground: the farthest ends the shadow.
    end = np.min(x - z * (light[0] - x) / (light[2] - z))
    assert end < -4.5
    lit = ridge.sees(np.array([end - 0.15, end + 0.15, -3.0, 10.0]), 0.0, light)
    np.testing.assert_array_equal(lit, [True, False, False, True])


def test_the_shadow_is_black_in_the_picture(ridge: World):
    position = {"tilt": 0.0, "turn": 0.0}
    in_shadow, in_light = project(ridge, np.array([[-3.5, 0.0, 0.0], [-9.0, 0.0, 0.0]]), position).round().astype(int)
    picture = ridge.picture(position)
    assert np.all(picture[in_shadow[1], in_shadow[0]] == 0.0)
    assert np.all(picture[in_light[1], in_light[0]] > 0.0)


def test_a_slanting_ray_meets_the_ridge_before_the_ground_behind_it(ridge: World):
    field = ridge.scene.surface.field
    # Aimed at the ground at x = -3, from the right, 45 degrees: it meets the right flank.
    t = first_hit(field, 97.0, 0.0, 100.0, -1.0, 0.0, -1.0)
    x, z = 97.0 - t, 100.0 - t
    assert RIDGE_HALF * 0.7 < x < RIDGE_HALF * 1.2 or abs(z - RIDGE_HEIGHT) < 0.01
    assert z == pytest.approx(float(ridge.truth(x, 0.0).depth), abs=1e-3)
    # From the left nothing is in the way.
    assert first_hit(field, -103.0, 0.0, 100.0, 1.0, 0.0, -1.0) == pytest.approx(100.0, abs=1e-3)
