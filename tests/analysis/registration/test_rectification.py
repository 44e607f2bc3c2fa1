import cv2
import numpy as np
import pytest

from analysis.camera.view import View
from analysis.radiometry.mosaic import channel_of_cell
from analysis.registration.grid import Grid
from analysis.registration.rectification import Rectified, rectify

HEIGHT, WIDTH = 240, 320
DISTORTION = np.array([-0.12, 0.05, 0.001, -0.0005, 0.0])


def tilted_view(tilt_deg: float = 35.0, azimuth_deg: float = 30.0, distortion: np.ndarray = DISTORTION) -> View:
    """A camera 150 mm away that looks at the centre; 2.4 pixels a millimetre."""
    tilt, azimuth = np.deg2rad([tilt_deg, azimuth_deg])
    centre = 150.0 * np.array([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)])
    forward = -centre / np.linalg.norm(centre)
    right = np.cross(forward, [0.0, 1.0, 0.0])
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(forward, right), forward])
    matrix = np.array([[360.0, 0.0, 161.3], [0.0, 362.0, 118.2], [0.0, 0.0, 1.0]])
    return View(matrix, distortion, rotation, -rotation @ centre)


VIEW = tilted_view()
GRID = Grid(30, 40, 0.6)
X, Y = (a.astype(np.float64) for a in np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT)))


def plane_points_under_pixels(view: View) -> tuple[np.ndarray, np.ndarray]:
    """Return x and y on the sample of the centre of every pixel, by intersecting its ray with the plane."""
    pixels = np.stack([X, Y], axis=-1).reshape(-1, 1, 2)
    ideal = cv2.undistortPoints(
        pixels,
        view.camera_matrix,
        view.distortion,
        criteria=(cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-12),
    ).reshape(-1, 2)
    rays = np.concatenate([ideal, np.ones((len(ideal), 1))], axis=1) @ view.rotation
    centre = -view.rotation.T @ view.translation
    points = centre - rays * (centre[2] / rays[:, 2])[:, None]
    return points[:, 0].reshape(HEIGHT, WIDTH), points[:, 1].reshape(HEIGHT, WIDTH)


def on_grid(picture: np.ndarray, pattern: str = "", view: View = VIEW, grid: Grid = GRID, **maps) -> Rectified:
    variance = maps.get("variance", np.ones_like(picture))
    saturated = maps.get("saturated", np.zeros(picture.shape, np.bool_))
    return rectify(
        picture.astype(np.float32), variance.astype(np.float32), saturated, pattern, view, grid.points(), grid.pitch
    )


def reference(picture: np.ndarray, colour: np.ndarray, x: float, y: float, along: np.ndarray) -> tuple[float, float]:
    """Fit the quadratic of one colour at one place by `lstsq`; value, and variance for noise of 1."""
    S = along @ along.T / 12.0 + 1.1**2 * np.eye(2)
    d = np.stack([X - x, Y - y], axis=-1)
    reach = 2.8 * np.sqrt(np.diag(S))
    use = colour & np.all(np.abs(d) <= reach, axis=-1)
    dx, dy = d[use].T
    root = np.exp(-0.25 * np.einsum("ni,ij,nj->n", d[use], np.linalg.inv(S), d[use]))
    A = np.stack([np.ones_like(dx), dx, dy, dx * dx, dx * dy, dy * dy], axis=-1)
    weights = np.linalg.pinv(root[:, None] * A)[0] * root
    return float(weights @ picture[use]), float(weights @ weights)


def wave(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return 2.0 + np.sin(0.5 * x + 0.3) * np.cos(0.4 * y)


def test_row_zero_of_the_grid_is_the_top_and_y_points_up():
    points = Grid(3, 5, 2.0).points()
    np.testing.assert_allclose(points[0, 0], [-4.0, 2.0, 0.0])
    np.testing.assert_allclose(points[-1, -1], [4.0, -2.0, 0.0])
    np.testing.assert_allclose(points[1, 2], 0.0)


def test_the_depth_is_the_third_coordinate_of_the_grid():
    depth = np.arange(15.0).reshape(3, 5)
    np.testing.assert_array_equal(Grid(3, 5, 2.0).points(depth)[..., 2], depth)


def test_a_grid_covers_the_area_to_half_a_pixel():
    assert Grid.covering((100.0, 50.0), 0.5) == Grid(100, 200, 0.5)
    assert Grid.covering((0.1, 0.1), 0.5) == Grid(1, 1, 0.5)


def test_projection_is_that_of_a_pinhole_with_the_lens_distortion():
    point = np.array([3.0, -4.0, 1.0])
    x, y, z = VIEW.rotation @ point + VIEW.translation
    k1, k2, p1, p2, _ = DISTORTION
    u, v = x / z, y / z
    r2 = u * u + v * v
    radial = 1.0 + k1 * r2 + k2 * r2 * r2
    u, v = u * radial + 2 * p1 * u * v + p2 * (r2 + 2 * u * u), v * radial + p1 * (r2 + 2 * v * v) + 2 * p2 * u * v
    np.testing.assert_allclose(VIEW.project(point), [360.0 * u + 161.3, 362.0 * v + 118.2], rtol=1e-9)


@pytest.mark.parametrize("pattern", ["", "RGGB", "GBRG"])
def test_an_even_picture_stays_even(pattern: str):
    np.testing.assert_allclose(on_grid(np.full((HEIGHT, WIDTH), 3.0), pattern).radiance, 3.0, rtol=1e-5)


@pytest.mark.parametrize("pattern", ["", "RGGB", "BGGR"])
def test_a_linear_ramp_is_reproduced_at_the_place_of_each_grid_pixel(pattern: str):
    out = on_grid(5.0 + 0.02 * X - 0.01 * Y, pattern)
    truth = 5.0 + 0.02 * out.pixels[..., 0] - 0.01 * out.pixels[..., 1]
    np.testing.assert_allclose(out.radiance, np.repeat(truth[..., None], out.radiance.shape[-1], axis=-1), atol=1e-4)


@pytest.mark.parametrize("pattern", ["", "RGGB"])
def test_a_pattern_on_the_plane_comes_back_where_it_was(pattern: str):
    """A shift shows as a share of the pattern's derivatives in what came back."""
    out = on_grid(wave(*plane_points_under_pixels(VIEW)), pattern)
    x, y, _ = np.moveaxis(GRID.points(), -1, 0)
    step = 1e-4
    d_x = (wave(x + step, y) - wave(x - step, y)) / (2 * step)
    d_y = (wave(x, y + step) - wave(x, y - step)) / (2 * step)
    A = np.stack([np.ones_like(x), wave(x, y), d_x, d_y], axis=-1).reshape(-1, 4)
    for channel in np.moveaxis(out.radiance, -1, 0):
        _, amplitude, shift_x, shift_y = np.linalg.lstsq(A, channel.ravel().astype(np.float64), rcond=None)[0]
        assert amplitude == pytest.approx(1.0, abs=0.05)
        assert np.hypot(shift_x, shift_y) * 2.4 < 0.02


def test_a_neutral_picture_has_equal_channels():
    out = on_grid(wave(*plane_points_under_pixels(VIEW)), "RGGB").radiance
    assert out.shape[-1] == 3
    np.testing.assert_allclose(out[..., 0], out[..., 1], rtol=0.01)
    np.testing.assert_allclose(out[..., 2], out[..., 1], rtol=0.01)


def test_each_channel_takes_from_its_own_colour_only():
    picture = np.zeros((HEIGHT, WIDTH))
    picture[0::2, 0::2], picture[1::2, 1::2] = 1.0, 3.0
    picture[0::2, 1::2] = picture[1::2, 0::2] = 2.0
    np.testing.assert_allclose(
        on_grid(picture, "RGGB").radiance, np.broadcast_to([1.0, 2.0, 3.0], (30, 40, 3)), rtol=1e-5
    )
    np.testing.assert_allclose(
        on_grid(picture, "BGGR").radiance, np.broadcast_to([3.0, 2.0, 1.0], (30, 40, 3)), rtol=1e-5
    )


def test_the_cell_of_a_pattern_is_read_row_by_row():
    np.testing.assert_array_equal(channel_of_cell("grbg"), [[1, 0], [2, 1]])
    np.testing.assert_array_equal(channel_of_cell(""), [[0, 0], [0, 0]])


@pytest.mark.parametrize("pattern", ["", "RGGB"])
def test_the_stated_variance_is_the_scatter_over_draws(pattern: str):
    rng = np.random.default_rng(0)
    sigma = 0.5 + X / WIDTH
    draws = [on_grid(sigma * rng.standard_normal(sigma.shape), pattern, variance=sigma**2) for _ in range(60)]
    scatter = np.var([d.radiance for d in draws], axis=0)
    ratio = scatter / draws[0].variance
    assert ratio.mean() == pytest.approx(1.0, abs=0.05)


def test_a_coarse_grid_averages_more_noise_away():
    fine, coarse = (on_grid(np.ones((HEIGHT, WIDTH)), grid=Grid(8, 8, pitch)) for pitch in (0.2, 3.0))
    assert coarse.variance.mean() < 0.3 * fine.variance.mean()


def test_what_lies_outside_the_picture_is_missing():
    out = on_grid(np.ones((HEIGHT, WIDTH)), grid=Grid(30, 40, 6.0))
    x, y = np.moveaxis(out.pixels, -1, 0)
    outside = (x < 0) | (x > WIDTH - 1) | (y < 0) | (y > HEIGHT - 1)
    well_inside = (x > 20) & (x < WIDTH - 21) & (y > 20) & (y < HEIGHT - 21)
    assert outside.any()
    assert well_inside.any()
    missing = np.isnan(out.radiance[..., 0])
    assert missing[outside].all()
    assert not missing[well_inside].any()
    np.testing.assert_array_equal(missing, np.isnan(out.variance[..., 0]))


def test_a_clipped_pixel_marks_the_grid_pixels_that_it_weighs_in():
    saturated = np.zeros((HEIGHT, WIDTH), np.bool_)
    i, j = 12, 17
    x, y = VIEW.project(GRID.points())[i, j]
    saturated[round(y), round(x)] = True
    marked = on_grid(np.ones((HEIGHT, WIDTH)), saturated=saturated).saturated[..., 0]
    assert marked[i, j] == 1
    assert 1 <= marked.sum() <= 25


def test_no_grid_pixel_is_moved_by_clipped_light_without_a_mark():
    """A highlight a hundred times as bright as what is around it shows at weights of a thousandth."""
    picture, saturated = np.ones((HEIGHT, WIDTH)), np.zeros((HEIGHT, WIDTH), np.bool_)
    picture[100:130, 150:170], saturated[100:130, 150:170] = 100.0, True
    out = on_grid(picture, "RGGB", saturated=saturated)
    moved = np.abs(out.radiance - 1.0) > 0.03
    assert moved.sum() > 100
    assert out.saturated[moved].all()
    assert not out.saturated[np.abs(out.radiance - 1.0) < 1e-4].any()


@pytest.mark.parametrize("pitch", [0.3, 0.6, 2.0])
def test_every_pixel_is_the_weighted_least_squares_fit_of_its_colour(pitch: float):
    """The footprint's axes come from finite differences of the projection here, distortion and all."""
    picture = np.random.default_rng(0).random((HEIGHT, WIDTH)).astype(np.float32)
    view = tilted_view(distortion=np.zeros(5))
    grid = Grid(9, 11, pitch)
    out = on_grid(picture, "GRBG", view, grid)
    cell = channel_of_cell("GRBG")[Y.astype(int) % 2, X.astype(int) % 2]
    half = 1e-3 * pitch
    for i, j in [(0, 0), (4, 5), (8, 2), (3, 10)]:
        point = grid.points()[i, j]
        steps = [view.project(point + half * e) - view.project(point - half * e) for e in np.eye(3)[:2]]
        along = np.stack(steps, axis=1) / (2.0 * half) * pitch
        for channel in range(3):
            value, variance = reference(picture, cell == channel, *out.pixels[i, j], along)
            assert out.radiance[i, j, channel] == pytest.approx(value, rel=1e-5)
            assert out.variance[i, j, channel] == pytest.approx(variance, rel=1e-5)


@pytest.mark.parametrize("pattern", ["", "RGGB"])
def test_a_quadratic_is_reproduced_exactly(pattern: str):
    def quadratic(x, y):
        return 5.0 + 0.02 * x - 0.01 * y + 1e-4 * x * x - 2e-4 * x * y + 3e-4 * y * y

    out = on_grid(quadratic(X, Y), pattern)
    truth = quadratic(*np.moveaxis(out.pixels, -1, 0))
    np.testing.assert_allclose(out.radiance, np.broadcast_to(truth[..., None], out.radiance.shape), rtol=1e-6)


@pytest.mark.parametrize("rows", [1, 7, 30])
def test_blocks_of_rows_give_the_same_bits_as_the_whole(rows: int):
    picture = np.random.default_rng(1).random((HEIGHT, WIDTH)).astype(np.float32)
    whole, points = on_grid(picture, "RGGB"), GRID.points()
    nothing, ones = np.zeros(picture.shape, np.bool_), np.ones_like(picture)
    blocks = [
        rectify(picture, ones, nothing, "RGGB", VIEW, points[i : i + rows], GRID.pitch) for i in range(0, 30, rows)
    ]
    for name in ("radiance", "variance", "saturated", "pixels"):
        np.testing.assert_array_equal(np.concatenate([getattr(b, name) for b in blocks]), getattr(whole, name))


def test_a_picture_with_channels_is_each_channel_on_its_own():
    picture = np.random.default_rng(2).random((HEIGHT, WIDTH, 3)).astype(np.float32)
    saturated = np.zeros(picture.shape, np.bool_)
    saturated[120, 160, 1] = True
    together = on_grid(picture, variance=picture, saturated=saturated)
    for k in range(3):
        alone = on_grid(picture[..., k], variance=picture[..., k], saturated=saturated[..., k])
        np.testing.assert_array_equal(together.radiance[..., k], alone.radiance[..., 0])
        np.testing.assert_array_equal(together.variance[..., k], alone.variance[..., 0])
        np.testing.assert_array_equal(together.saturated[..., k], alone.saturated[..., 0])
    assert together.saturated.any()


def test_a_picture_with_channels_and_a_pattern_is_refused():
    with pytest.raises(ValueError, match="has all channels at every pixel; its pattern is ''"):
        on_grid(np.ones((HEIGHT, WIDTH, 3)), "RGGB")


def checker_shift(tilt: float, azimuth: float) -> float:
    """Return by how many pixels a checker seen from a pose is shifted on the grid, in the worst colour."""
    view = tilted_view(tilt, azimuth)
    x, y = plane_points_under_pixels(view)
    edge = 0.6  # mm, of the printed checker's soft edges, so that the picture is sampled finely enough
    checker = 2.0 + np.tanh(np.sin(0.6 * x) * np.sin(0.6 * y) / 0.6 / edge)
    out = on_grid(checker, "RGGB", view)
    gx, gy, _ = np.moveaxis(GRID.points(), -1, 0)

    def truth(dx: float, dy: float) -> np.ndarray:
        return 2.0 + np.tanh(np.sin(0.6 * (gx - dx)) * np.sin(0.6 * (gy - dy)) / 0.6 / edge)

    step, shifts = 1e-3, []
    slopes = [(truth(step, 0) - truth(-step, 0)) / (2 * step), (truth(0, step) - truth(0, -step)) / (2 * step)]
    for channel in np.moveaxis(out.radiance, -1, 0):
        seen = np.isfinite(channel)
        A = np.stack([np.ones_like(gx), truth(0, 0), *slopes], axis=-1)[seen]
        shift = np.linalg.lstsq(A, channel[seen].astype(np.float64), rcond=None)[0][2:]
        shifts.append(np.hypot(*(view.project(np.array([*shift, 0.0])) - view.project(np.zeros(3)))))
    return float(max(shifts))


@pytest.mark.parametrize("tilt", [0.0, 20.0, 45.0, 60.0])
@pytest.mark.parametrize("azimuth", [0.0, 130.0, 250.0])
def test_a_checker_seen_from_any_pose_registers_within_a_tenth_of_a_pixel(tilt: float, azimuth: float):
    assert checker_shift(tilt, azimuth) < 0.1


def test_a_point_behind_the_lens_falls_nowhere():
    centre = -VIEW.rotation.T @ VIEW.translation
    assert np.isnan(VIEW.project(2.0 * centre)).all()
