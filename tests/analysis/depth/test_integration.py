import numpy as np
import pytest

from analysis.depth import integration
from analysis.depth.integration import integrate_normals, integrate_slopes, slopes_from_normals
from analysis.depth.uncertainty import depth_sigma
from analysis.evaluation.metrics import depth_rmse
from analysis.registration.grid import Grid
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


def wave(n: int, pitch: float, wavelength: float):
    x, y, _ = np.moveaxis(Grid(n, n, pitch).points(), -1, 0)
    k = 2.0 * np.pi / wavelength
    z = np.sin(k * x + 0.3) * np.cos(k * y + 1.0)
    return z, k * np.cos(k * x + 0.3) * np.cos(k * y + 1.0), -k * np.sin(k * x + 0.3) * np.sin(k * y + 1.0)


def integrated(p: np.ndarray, q: np.ndarray, pitch: float, **options) -> np.ndarray:
    return integrate_slopes(p, q, np.ones(p.shape, bool), pitch, **options)


@pytest.mark.parametrize("options", [{}, {"sigma": np.full((64, 64), 0.01)}], ids=["direct", "multigrid"])
def test_half_the_pitch_leaves_a_twelfth_of_the_error(options):
    errors = []
    for pitch in (0.6, 0.3):
        z, p, q = wave(64, pitch, 9.0)
        errors.append(depth_rmse(integrated(p, q, pitch, **options), z))
    assert errors[1] < errors[0] / 12.0


def test_a_texture_of_ten_pixels_is_recovered_to_half_a_percent():
    z, p, q = wave(200, 1.0, 10.0)
    assert depth_rmse(integrated(p, q, 1.0), z) < 0.005 * np.std(z)


@pytest.mark.parametrize("shape", [(40, 33), (1, 30), (30, 1), (1, 1), (17, 2), (1, 131), (131, 1)])
def test_multigrid_and_cosine_transform_agree(shape: tuple[int, int]):
    # Small slopes, so that equal sigmas of the normals are as good as equal sigmas of the slopes.
    p, q = np.random.default_rng(0).normal(0.0, 1e-5, (2, *shape))
    iterated = integrated(p, q, PITCH, tolerance=1e-10, sigma=np.full(shape, 0.01))
    np.testing.assert_allclose(iterated, integrated(p, q, PITCH), atol=1e-12)


def test_single_precision_would_be_enough_and_double_agrees_with_it():
    """The transform of 2000 x 2000 pixels in either precision: what is lost is far below a micrometre."""
    _, p, q = wave(2000, 0.05, 9.0)
    right_side = integration._full_right_side(p, q, 0.05)
    single = integration._solve_poisson(right_side.astype(np.float32))
    assert single.dtype == np.float32
    assert np.abs(single - integration._solve_poisson(right_side)).max() < 2e-5


def test_an_area_without_pixels_has_no_depth():
    assert integrate_normals(np.zeros((0, 5, 3)), PITCH).shape == (0, 5)


@pytest.mark.parametrize("holes", [False, True])
def test_a_plane_added_to_the_slopes_is_added_to_the_depth(holes: bool):
    x, y, _ = np.moveaxis(Grid(30, 41, PITCH).points(), -1, 0)
    p, q = np.random.default_rng(3).normal(0.0, 0.2, (2, 30, 41))
    valid = np.ones(p.shape, bool)
    valid[5:20, 7:11] = not holes
    one = integrate_slopes(p, q, valid, PITCH, 1e-9)
    two = integrate_slopes(p + 0.1, q - 0.3, valid, PITCH, 1e-9)
    assert error(np.where(valid, two - one, np.nan), 0.1 * x - 0.3 * y) < 1e-6


@pytest.mark.parametrize("holes", [False, True])
def test_transposing_the_area_transposes_the_depth(holes: bool):
    p, q = np.random.default_rng(4).normal(0.0, 0.2, (2, 30, 41))
    valid = np.ones(p.shape, bool)
    valid[5:20, 7:11] = not holes
    # Transposed, x runs down: x and -y change places.
    one = integrate_slopes(p, q, valid, PITCH, 1e-9)
    two = integrate_slopes(-q.T, -p.T, valid.T, PITCH, 1e-9)
    np.testing.assert_allclose(two.T[valid], one[valid], atol=1e-6)


def test_each_part_that_holes_cut_off_has_mean_zero():
    _, normals = surface(30, 31, quadratic)
    normals[:, 15] = np.nan
    depth = integrate_normals(normals, PITCH)
    assert np.mean(depth[:, :15]) == pytest.approx(0.0, abs=1e-10)
    assert np.mean(depth[:, 16:]) == pytest.approx(0.0, abs=1e-10)


def test_a_wrong_band_that_says_so_does_not_bend_the_rest():
    truth, normals = surface(80, 80, quadratic)
    wrong = normals.copy()
    wrong[20:80, 40:44] += [0.3, 0.0, 0.0]
    wrong /= np.linalg.norm(wrong, axis=-1, keepdims=True)
    sigma = np.full((80, 80), 0.002)
    sigma[20:80, 40:44] = 0.3
    rest = sigma < 0.1
    weighted, unweighted = (
        np.where(rest, integrate_normals(wrong, PITCH, **options), np.nan) for options in ({"sigma": sigma}, {})
    )
    assert error(unweighted, truth) > 0.1
    assert error(weighted, truth) < 0.005


def test_pixels_that_have_no_sigma_are_holes():
    _, normals = surface(20, 20, quadratic)
    sigma = np.full((20, 20), 0.01)
    sigma[3, 4] = np.nan
    assert np.flatnonzero(np.isnan(integrate_normals(normals, PITCH, sigma=sigma))).tolist() == [64]


def test_a_few_tiny_sigmas_and_a_few_zeros_do_no_harm():
    truth, normals = surface(40, 40, quadratic)
    sigma = np.full((40, 40), 0.01)
    sigma[::7, ::5], sigma[3, 3] = 1e-9, 0.0
    assert error(integrate_normals(normals, PITCH, sigma=sigma), truth) < 1e-4


def test_depth_does_not_depend_on_the_unit_of_the_sigmas():
    p, q = np.random.default_rng(5).normal(0.0, 0.2, (2, 30, 30))
    sigma = np.random.default_rng(6).uniform(0.001, 0.1, (30, 30))
    one, two = (integrated(p, q, PITCH, tolerance=1e-10, sigma=k * sigma) for k in (1.0, 7.0))
    np.testing.assert_allclose(one, two, atol=1e-7)


def flap(n: int):
    """A smooth ground, the upper right of which is bent up along one line and torn loose along the other."""
    x, y, _ = np.moveaxis(Grid(n, n, PITCH).points(), -1, 0)
    up = (x > 0.0) & (y > 0.0)
    ground, p, q = 0.2 * np.sin(0.5 * x), 0.1 * np.cos(0.5 * x), np.zeros_like(y)
    return ground + np.where(up, 0.2 * y, 0.0), p, q + np.where(up, 0.2, 0.0)


def test_blocks_give_the_sigma_of_depth_that_every_pixel_gives(monkeypatch: pytest.MonkeyPatch):
    sigma = np.full((150, 150), 0.01)
    sigma[:, 75:] = 0.03
    full = depth_sigma(sigma, PITCH, np.random.default_rng(0), n_draws=100)
    monkeypatch.setattr("analysis.depth.uncertainty.MAX_DRAWN", 40)
    blocks = depth_sigma(sigma, PITCH, np.random.default_rng(1), n_draws=100)
    assert np.median(blocks / full) == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize("shape", [(1, 300), (300, 1)])
def test_a_long_row_of_pixels_has_a_depth_and_its_sigma(shape: tuple[int, int]):
    truth, normals = surface(*shape, quadratic)
    sigma = np.full(shape, 0.01)
    assert error(integrate_normals(normals, PITCH, sigma=sigma), truth) < 1e-4
    assert np.all(depth_sigma(sigma, PITCH, np.random.default_rng(0), weighted=True) > 0.0)


def test_holes_have_no_depth_whether_slopes_or_normals_are_integrated():
    _, normals = surface(20, 20, quadratic)
    p, q, valid = slopes_from_normals(with_holes(normals))
    np.testing.assert_array_equal(np.isfinite(integrate_slopes(p, q, valid, PITCH)), valid)


def test_the_sigma_of_depth_of_nothing_is_missing():
    assert np.isnan(depth_sigma(np.full((4, 5), np.nan), PITCH, np.random.default_rng(0))).all()
