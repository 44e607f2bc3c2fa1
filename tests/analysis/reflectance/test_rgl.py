"""Materials of the RGL database: files made of formulas, and the measured ones where they are at hand."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.reflectance.merl import cell_angles, fill_unmeasured
from analysis.reflectance.rgl import RglBrdf, _directions, _Warp, reciprocity_error
from analysis.reflectance.rgl_file import read_rgl
from tests.rgl_files import THETA_I, Array, Brdf, lambert, node_directions, rgl_fields, write_rgl

SHARED = Path(os.environ.get("HALFANGLE_SHARED_DATA", Path(__file__).parents[4] / "shared" / "data"))

MEASURED = (
    "acrylic_felt_white",
    "cc_ibiza_sunset",
    "colodur_napoli_4f",
    "ilm_solo_m_68",
    "irid_flake_paint2",
    "leaf_maple",
    "paper_white",
    "satin_purple",
)


def measured_file(name: str) -> Path:
    path = SHARED / "measured_brdf" / f"{name}_rgb.bsdf"
    if not path.exists():
        pytest.skip(f"{path} is not there: set HALFANGLE_SHARED_DATA to the folder with measured_brdf")
    return path


def material(folder: Path, brdf: Brdf = lambert, **how: Any) -> RglBrdf:
    return read_rgl(write_rgl(folder / "made_rgb.bsdf", rgl_fields(brdf, **how)))


def random_directions(rng: np.random.Generator, n: int, low: float, high: float, lowest: float = 0.02) -> Array:
    """Return directions with cosines from `lowest` to 1 and azimuths between two angles in degrees, of 32 bits."""
    c, phi = rng.uniform(lowest, 1.0, n), np.deg2rad(rng.uniform(low, high, n))
    s = np.sqrt(1.0 - c**2)
    return np.stack([s * np.cos(phi), s * np.sin(phi), c], axis=-1).astype(np.float32).astype(np.float64)


def grazing(omega_i: Array, omega_o: Array) -> Array:
    """A reciprocal BRDF: its highlight and its edge go by the half vector and the difference angle."""
    omega_h = omega_i + omega_o
    length = np.linalg.norm(omega_h, axis=-1)
    n_dot_h, cos_d = omega_h[..., 2] / length, length / 2.0
    value = 0.1 + 0.3 * n_dot_h**20 + 0.2 * (1.0 - cos_d) ** 2
    return value[..., None] * np.array([1.0, 0.5, 0.25])


def test_at_its_nodes_a_file_gives_the_brdf_that_it_was_made_of(tmp_path: Path):
    made = material(tmp_path, grazing)
    for theta in THETA_I:
        omega_i, omega_o = node_directions(theta, 33)
        above = omega_o[..., 2] > 1e-3
        # On the seam at phi = pi, the nodes of both edges are one direction.
        np.testing.assert_allclose(made.evaluate(omega_i, omega_o[above]), grazing(omega_i, omega_o[above]), rtol=2e-4)


def test_between_nodes_the_error_falls_with_the_square_of_their_distance(tmp_path: Path):
    omega_i = node_directions(THETA_I[3], 3)[0]
    omega_o = random_directions(np.random.default_rng(0), 2000, 0.0, 360.0, lowest=0.5)
    off = [np.abs(material(tmp_path, n=n).evaluate(omega_i, omega_o) / lambert(omega_i, omega_o) - 1) for n in (33, 65)]
    assert off[0].max() < 0.02
    assert np.sqrt(np.mean(off[1] ** 2)) < 0.3 * np.sqrt(np.mean(off[0] ** 2))


def test_turning_light_and_view_together_changes_nothing(tmp_path: Path):
    made, rng = material(tmp_path, grazing), np.random.default_rng(0)
    omega_i, omega_o = (random_directions(rng, 300, 0.0, 360.0) for _ in range(2))
    c, s = np.cos(1.1), np.sin(1.1)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(made.evaluate(omega_i @ turn, omega_o @ turn), made.evaluate(omega_i, omega_o))


def test_nothing_is_reflected_below_the_horizon(tmp_path: Path):
    made, up, down = material(tmp_path), np.array([0.0, 0.6, 0.8]), np.array([0.6, 0.0, -0.8])
    assert made.evaluate(up, down).tolist() == made.evaluate(down, up).tolist() == [0.0, 0.0, 0.0]
    assert made.evaluate(up, np.stack([up, down])).shape == (2, 3)
    assert np.all(made.evaluate(up, up) > 0.0)


def test_a_file_without_the_jacobian_holds_the_brdf_times_the_cosine(tmp_path: Path):
    fields = rgl_fields() | {"jacobian": np.zeros(1, np.uint8)}
    fields["rgb"][:] = np.array([0.1, 0.2, 0.3])[:, None, None]
    made = read_rgl(write_rgl(tmp_path / "a.bsdf", fields))
    up, aside = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.6, 0.8])
    np.testing.assert_allclose(made.evaluate(up, aside), np.array([0.1, 0.2, 0.3]) / 0.8, rtol=1e-6)


def test_the_warp_gives_each_area_the_share_of_the_density_that_lies_on_it():
    """The determinant of its derivatives is the density, also between two theta_i, and edges stay edges."""
    rng = np.random.default_rng(0)
    warp, n = _Warp.from_density(rng.uniform(0.2, 2.0, (2, 5, 7))), 400
    x, y = rng.uniform(0.01, 0.99, (2, n))
    row = np.zeros(n, np.int64), rng.uniform(size=n)
    step = 1e-6
    x_x, x_y = warp.invert(x + step, y, row)
    y_x, y_y = warp.invert(x, y + step, row)
    x_0, y_0 = warp.invert(x, y, row)
    area = ((x_x - x_0) * (y_y - y_0) - (y_x - x_0) * (x_y - y_0)) / step**2
    j, k = np.minimum(x * 6, 5).astype(int), np.minimum(y * 4, 3).astype(int)
    u, v = x * 6 - j, y * 4 - k
    density = (1 - row[1])[:, None, None] * warp.density[0] + row[1][:, None, None] * warp.density[1]
    low, high = ((1 - u) * density[range(n), r, j] + u * density[range(n), r, j + 1] for r in (k, k + 1))
    np.testing.assert_allclose(area, ((1 - v) * low + v * high) * 6 * 4, rtol=1e-3)
    edge, place = np.array([0.0, 1.0]), (np.zeros(2, np.int64), np.full(2, 0.3))
    np.testing.assert_allclose(warp.invert(edge, edge, place), [edge, edge], atol=1e-12)


def test_the_directions_stand_at_their_angles():
    theta_d, phi_d = np.deg2rad([0.5, 30.0, 60.0])[:, None], np.deg2rad([10.0, 100.0])
    omega_i, omega_o = _directions(0.4, theta_d, phi_d)
    omega_h = (omega_i + omega_o) / np.linalg.norm(omega_i + omega_o, axis=-1, keepdims=True)
    np.testing.assert_allclose(np.arccos(omega_h[..., 2]), 0.4)
    np.testing.assert_allclose(np.arccos(np.sum(omega_i * omega_h, axis=-1)), np.broadcast_to(theta_d, (3, 2)))
    np.testing.assert_allclose(_directions(0.4, theta_d, phi_d + np.pi)[0], omega_o, atol=1e-12)


def test_the_average_of_a_reciprocal_material_is_the_material(tmp_path: Path):
    mean, n_measured = material(tmp_path, grazing, n=49).average()
    theta_h, theta_d, _ = cell_angles()
    edge = 0.2 * (1.0 - np.cos(theta_d)) ** 2
    assert mean.shape == n_measured.shape == (3, 90, 90)
    full = n_measured[0] == 180
    assert 0.4 < full.mean() < 0.8
    expected = (0.1 + 0.3 * np.cos(theta_h[:, None]) ** 20 + edge) * np.array([1.0, 0.5, 0.25])[:, None, None]
    off = np.abs(mean / expected - 1.0)[:, full]
    assert np.median(off) < 0.005
    assert off.max() < 0.1
    np.testing.assert_allclose(np.abs(mean[:, :60, 0] / expected[:, :60, 0] - 1.0), 0.0, atol=0.02)


def test_what_leans_more_than_the_last_theta_i_counts_as_not_measured(tmp_path: Path):
    """Also where the file goes on to 90 deg by repeating it."""
    fields = rgl_fields(theta_i=np.append(THETA_I, np.pi / 2))
    fields["rgb"][:, -1] = fields["rgb"][:, -2]
    repeated = read_rgl(write_rgl(tmp_path / "a.bsdf", fields))
    theta_h, theta_d, _ = cell_angles()
    for made in (material(tmp_path), repeated):
        assert made.theta_max == pytest.approx(THETA_I[-1])
        mean, n_measured = made.average()
        np.testing.assert_array_equal(np.isnan(mean), n_measured == 0)
        assert n_measured[0, 0, theta_d < THETA_I[-1] - 0.01].min() == 180
        assert n_measured[:, theta_h > THETA_I[-1]].max() == n_measured[:, :, theta_d > THETA_I[-1]].max() == 0
        assert np.isfinite(fill_unmeasured(mean)).all()


def test_light_and_view_enter_the_average_in_both_orders(tmp_path: Path):
    def leaning(omega_i: Array, omega_o: Array) -> Array:
        return lambert(omega_i, omega_o) * (1.0 + 0.5 * (omega_i[..., 2:] - omega_o[..., 2:]))

    made = material(tmp_path, leaning, n=65)
    mean, n_measured = made.average()
    inner = n_measured[0, :60, :50] == 180
    assert inner.mean() > 0.8
    off = np.abs(mean[1, :60, :50][inner] / 0.2 - 1.0)
    assert np.median(off) < 0.005
    assert off.max() < 0.05
    theta = np.deg2rad(np.arange(10.0, 61.0, 5.0))
    expected = np.sqrt(np.mean(np.subtract.outer(np.cos(theta), np.cos(theta)) ** 2))
    assert reciprocity_error(made) == pytest.approx(expected, rel=0.05)
    assert reciprocity_error(material(tmp_path, grazing, n=65)) < 0.01


def test_the_noise_of_a_black_material_is_not_averaged_to_less_than_nothing(tmp_path: Path):
    fields = rgl_fields()
    fields["rgb"] *= -0.001
    fields["rgb"][0, 2, :, 5, 5] = 1e-6
    made = read_rgl(write_rgl(tmp_path / "a.bsdf", fields))
    mean, _ = made.average()
    assert np.nanmin(mean) == 0.0
    assert np.isnan(reciprocity_error(made))


def of_mitsuba(path: Path, omega_i: Array, omega_o: Array) -> NDArray[np.float64]:
    """Return the BRDF times cos theta_o as Mitsuba evaluates it, shape (n, 3)."""
    mi = pytest.importorskip("mitsuba", reason="Mitsuba is not installed: pip install 'halfangle[validate]'")
    mi.set_variant("scalar_rgb")
    bsdf, context = mi.load_dict({"type": "measured", "filename": str(path)}), mi.BSDFContext()
    values = []
    for i, o in zip(omega_i, omega_o, strict=True):
        point = mi.SurfaceInteraction3f()
        point.wi = i
        values.append(list(bsdf.eval(context, point, o)))
    return np.array(values)


def off_mitsuba(path: Path) -> tuple[float, float]:
    """Return the RMS and the greatest difference over 0.001 + the value, half of the directions near the mirror's."""
    rng, n = np.random.default_rng(0), 4000
    # Mitsuba 3.9 leaves a sign of isotropic materials unset, which mirrors the material where omega_i has another.
    omega_i, omega_o = random_directions(rng, n, 181.0, 269.0), random_directions(rng, n, 0.0, 360.0)
    mirrored = omega_i[::2] * [-1.0, -1.0, 1.0] + rng.normal(scale=0.05, size=(n // 2, 3))
    mirrored[:, 2] = np.abs(mirrored[:, 2])
    omega_o[::2] = (mirrored / np.linalg.norm(mirrored, axis=1, keepdims=True)).astype(np.float32)
    theirs = of_mitsuba(path, omega_i, omega_o)
    ours = read_rgl(path).evaluate(omega_i, omega_o) * omega_o[:, 2:]
    off = np.abs(ours - theirs) / (1e-3 + np.abs(theirs))
    return float(np.sqrt(np.mean(off**2))), float(off.max())


def test_a_warped_file_is_evaluated_as_by_mitsuba(tmp_path: Path):
    fields, rng = rgl_fields(grazing), np.random.default_rng(0)
    fields["vndf"] = rng.uniform(0.2, 2.0, (1, len(THETA_I), 9, 12)).astype(np.float32)
    fields["rgb"] = rng.uniform(0.1, 1.0, fields["rgb"].shape).astype(np.float32)
    rms, most = off_mitsuba(write_rgl(tmp_path / "a.bsdf", fields))
    assert rms < 2e-5
    assert most < 1e-3


@pytest.mark.parametrize("name", MEASURED)
def test_a_measured_material_is_evaluated_as_by_mitsuba(name: str):
    """To the rounding of Mitsuba's 32 bits."""
    rms, most = off_mitsuba(measured_file(name))
    assert rms < 2e-5
    assert most < 1e-3


@pytest.mark.parametrize(
    ("name", "low", "high"),
    [("acrylic_felt_white", 0.01, 0.025), ("paper_white", 0.015, 0.035), ("colodur_napoli_4f", 0.02, 0.04)],
)
def test_a_measured_matte_material_is_reciprocal_to_a_few_per_cent(name: str, low: float, high: float):
    """It would be off by 20 % if the file's values were taken for the BRDF without the cosine."""
    assert low < reciprocity_error(read_rgl(measured_file(name))) < high


def test_the_slice_of_a_measured_material_goes_on_from_what_lies_beside_it():
    """No instrument sees along its own light, so that the database made up what stands at theta_d = 0."""
    made = read_rgl(measured_file("paper_white"))
    mean, n_measured = made.average()
    table = fill_unmeasured(mean)
    np.testing.assert_allclose(table[:, :60, 0] / table[:, :60, 5], 1.0, atol=0.05)
    assert (n_measured > 0).mean() > 0.7
    # Paper of an albedo below 1, of nearly one colour.
    assert np.all((table[:, :60, 0] > 0.2) & (table[:, :60, 0] < 1.0 / np.pi + 0.02))
