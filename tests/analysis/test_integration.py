import numpy as np
import pytest

from analysis.integration import depth_sigma, integrate_normals, slopes_from_normals
from analysis.metrics import depth_rmse
from analysis.rectification import Grid
from tests.synthetic import relief

PITCH = 0.3


def surface(height: int, width: int, f, pitch: float = PITCH):
    """Return depth of mean 0 and normals of z = f(x, y) -> (z, dz/dx, dz/dy) on the grid."""
    x, y, _ = np.moveaxis(Grid(height, width, pitch).points(), -1, 0)
    z, p, q = f(x, y)
    n = np.stack([-p, -q, np.ones_like(p)], axis=-1)
    return z - z.mean(), n / np.linalg.norm(n, axis=-1, keepdims=True)


def quadratic(x, y):
    a, b, c = 0.01, -0.006, 0.015
    return a * x * x + b * x * y + c * y * y, 2 * a * x + b * y, b * x + 2 * c * y


def tilted(x, y):
    return 0.1 * x - 0.2 * y, np.full_like(x, 0.1), np.full_like(x, -0.2)


def bump_up_right(x, y):
    """A bump whose centre lies to the right of and above the middle."""
    u, v = x - 1.95, y - 3.15
    z = np.exp(-(u * u + v * v) / 4.0)
    return z, -u / 2.0 * z, -v / 2.0 * z


def with_holes(normals: np.ndarray) -> np.ndarray:
    holed = normals.copy()
    rng = np.random.default_rng(0)
    holed[rng.random(holed.shape[:2]) < 0.05] = np.nan
    holed[5:12, 8:15] = np.nan
    return holed


def error(depth: np.ndarray, truth: np.ndarray) -> float:
    """Return the largest difference over the common pixels, both freed of their mean."""
    difference = (depth - truth)[np.isfinite(depth)]
    return float(np.abs(difference - difference.mean()).max())


@pytest.mark.parametrize("shape", [(40, 40), (23, 51), (51, 23), (1, 30), (30, 1)])
def test_a_quadratic_surface_is_recovered_exactly(shape: tuple[int, int]):
    truth, normals = surface(*shape, quadratic)
    assert error(integrate_normals(normals, PITCH), truth) < 1e-9


@pytest.mark.parametrize("shape", [(40, 40), (23, 51)])
def test_a_quadratic_surface_with_holes_is_recovered(shape: tuple[int, int]):
    truth, normals = surface(*shape, quadratic)
    holed = with_holes(normals)
    depth = integrate_normals(holed, PITCH)
    assert error(depth, truth) < 1e-4
    np.testing.assert_array_equal(np.isnan(depth), np.isnan(holed[..., 0]))


@pytest.mark.parametrize("holes", [False, True])
def test_an_egg_box_is_recovered_to_a_hundredth_of_its_height(holes: bool):
    x, y, _ = np.moveaxis(Grid(60, 80, PITCH).points(), -1, 0)
    z, normals = relief(x, y)
    depth = integrate_normals(with_holes(normals) if holes else normals, PITCH)
    assert depth_rmse(depth, z) < 0.01 * np.ptp(z)


def test_a_finer_grid_recovers_an_egg_box_better():
    errors = []
    for n, pitch in ((20, 0.8), (40, 0.4)):
        x, y, _ = np.moveaxis(Grid(n, n, pitch).points(), -1, 0)
        z, normals = relief(x, y)
        errors.append(error(integrate_normals(normals, pitch), z))
    assert errors[1] < 0.4 * errors[0]


def test_a_tilted_plane_stays_a_tilted_plane():
    truth, normals = surface(30, 45, tilted)
    assert error(integrate_normals(normals, PITCH), truth) < 1e-9


def test_depth_has_mean_zero_over_the_pixels_it_is_known_at():
    _, normals = surface(30, 30, quadratic)
    assert np.mean(integrate_normals(normals, PITCH)) == pytest.approx(0.0, abs=1e-12)
    assert np.nanmean(integrate_normals(with_holes(normals), PITCH)) == pytest.approx(0.0, abs=1e-12)


def test_depth_is_in_the_unit_of_the_pitch():
    _, normals = surface(20, 20, tilted)
    one, ten = integrate_normals(normals, 1.0), integrate_normals(normals, 10.0)
    np.testing.assert_allclose(ten, 10.0 * one, atol=1e-9)


@pytest.mark.parametrize("holes", [False, True])
def test_a_bump_stays_a_bump_where_it_was(holes: bool):
    """Normals lean away from the top; up in the picture is plus y."""
    truth, normals = surface(60, 50, bump_up_right)
    top = np.unravel_index(np.argmax(truth), truth.shape)
    assert top[0] < 30
    assert top[1] > 25
    assert normals[top[0] - 8, top[1], 1] > 0.1  # above the top they lean up
    assert normals[top[0], top[1] + 8, 0] > 0.1  # to the right of it they lean to the right
    if holes:
        normals[50:55, 5:9] = np.nan
    depth = integrate_normals(normals, PITCH)
    assert np.unravel_index(np.nanargmax(depth), depth.shape) == top
    assert error(depth, truth) < 0.01


def test_an_island_that_holes_cut_off_keeps_its_own_shape():
    truth, normals = surface(30, 30, quadratic)
    normals[10:21, 10], normals[10:21, 20] = np.nan, np.nan
    normals[10, 10:21], normals[20, 10:21] = np.nan, np.nan
    depth = integrate_normals(normals, PITCH)
    inside = (slice(11, 20), slice(11, 20))
    assert error(depth[inside], truth[inside]) < 1e-4
    outside = depth.copy()
    outside[inside] = np.nan
    assert error(outside, truth) < 1e-4


def test_a_lone_pixel_has_a_finite_height():
    _, normals = surface(9, 9, tilted)
    normals[2:7, 2:7] = np.nan
    normals[4, 4] = [0.0, 0.0, 1.0]
    depth = integrate_normals(normals, PITCH)
    assert np.isfinite(depth[4, 4])
    assert np.isnan(depth[3, 3])


def test_without_any_normal_there_is_no_depth_and_no_crash():
    assert np.isnan(integrate_normals(np.full((5, 7, 3), np.nan), PITCH)).all()


def test_normals_that_lie_down_or_point_away_count_as_holes():
    normals = np.zeros((4, 4, 3))
    normals[..., 2] = 1.0
    normals[1, 1] = [0.999, 0.0, np.sqrt(1.0 - 0.999**2)]
    normals[2, 2] = [0.0, 0.0, -1.0]
    _, _, valid = slopes_from_normals(normals)
    assert np.flatnonzero(~valid).tolist() == [5, 10]


def test_the_sigma_of_depth_grows_with_that_of_the_normals_and_is_missing_in_holes():
    sigma = np.full((20, 30), 0.01)
    sigma[4, 4] = np.nan
    one, two = (depth_sigma(k * sigma, PITCH, np.random.default_rng(0)) for k in (1.0, 2.0))
    assert np.isnan(one[4, 4])
    np.testing.assert_allclose(np.nanmean(two / one), 2.0, rtol=1e-2)


def test_the_sigma_of_depth_is_the_scatter_of_depths_from_noisy_normals():
    rng = np.random.default_rng(1)
    depths = []
    for _ in range(40):
        slopes = 0.01 * rng.standard_normal((2, 20, 30))
        normals = np.stack([*slopes, np.ones((20, 30))], axis=-1)
        depths.append(integrate_normals(normals / np.linalg.norm(normals, axis=-1, keepdims=True), PITCH))
    stated = depth_sigma(np.full((20, 30), 0.01), PITCH, rng, n_draws=40)
    assert np.mean(stated) == pytest.approx(np.mean(np.std(depths, axis=0)), rel=0.1)
