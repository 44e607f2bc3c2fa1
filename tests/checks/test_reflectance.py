"""BRDFs: units, files of measured materials, and angles that nobody saw."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from analysis.pixels.fits import PixelFits
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import reconstruct
from analysis.reflectance import models
from analysis.reflectance.atoms import published
from analysis.reflectance.completion import THETA_D, THETA_H, atom_on_nodes, atoms_on_slice, complete_brdf
from analysis.reflectance.dictionary import from_published
from analysis.reflectance.merl import SHAPE, MerlBrdf, cell_angles, read_merl
from analysis.reflectance.models import Cosines, cosines_from_angles
from benchmarks.studies.beyond_slice import without
from tests.checks.conftest import Record
from tests.checks.test_light import lambertian_plane
from tests.merl_files import merl_brdf, write_merl
from tests.synthetic import make_stack, with_views


def directional_albedo(fits: PixelFits, theta_i_deg: float) -> np.ndarray:
    """Integrate f cos theta_o over the hemisphere for light at an angle, by the midpoint rule, shape (P, C)."""
    theta, phi = np.meshgrid((np.arange(24) + 0.5) * np.pi / 48, (np.arange(32) + 0.5) * np.pi / 16, indexing="ij")
    omega_o = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(
        -1, 3
    )
    solid_angle = (np.sin(theta) * np.pi / 48 * np.pi / 16).ravel()
    up, light = np.array([0.0, 0.0, 1.0]), np.deg2rad(theta_i_deg)
    omega_i = np.array([np.sin(light), 0.0, np.cos(light)])
    n_pixels = len(fits.normals)
    directions = (np.broadcast_to(d, (n_pixels, *omega_o.shape)) for d in (up, omega_i, omega_o))
    f = fits.brdf(Cosines.from_directions(*directions))
    return np.einsum("pkc,k->pc", f, solid_angle * omega_o[:, 2])


@pytest.mark.check(15)
def test_a_white_patch_has_the_brdf_of_a_white_patch(record: Record) -> None:
    fits = reconstruct(lambertian_plane(0.99, size=8, extent=20.0), Options(palette="off")).fits
    f = fits.brdf(Cosines.on_slice(np.broadcast_to(np.deg2rad([10.0, 25.0, 40.0]), (64, 3))))
    off = np.abs(np.median(f, axis=0) * np.pi / 0.99 - 1.0).max()
    record.at_most("BRDF of a Lambertian patch of 0.99 over 0.99 / π, less 1", 100.0 * off, 1.0, "%")
    albedo = max(np.median(directional_albedo(fits, angle)) for angle in (0.0, 30.0, 60.0))
    record.at_most("its directional albedo, light at 0, 30 and 60°", albedo, 1.0)


@pytest.mark.check(16)
def test_a_file_of_the_merl_format_is_understood_as_it_is_meant(record: Record, tmp_path: Path) -> None:
    write_merl(tmp_path / "one.binary", merl_brdf(2))
    write_merl(tmp_path / "two.binary", read_merl(tmp_path / "one.binary"))
    content = (tmp_path / "one.binary").read_bytes()
    differ = np.sum(np.frombuffer(content, np.uint8) != np.frombuffer((tmp_path / "two.binary").read_bytes(), np.uint8))
    record.at_most("bytes that differ after write, read and write", differ, 0)
    # By the format's description, with none of our reader: planes of red, green, blue, theta_h by its square root.
    planes = np.frombuffer(content, "<f8", offset=12).reshape(3, 90, 90, 180)
    i, j, k = (a.ravel() for a in np.meshgrid([2, 20, 55], [5, 30], [10, 90], indexing="ij"))
    angles = np.deg2rad((i + 0.5) ** 2 / 90.0), np.deg2rad(j + 0.5), np.deg2rad(k + 0.5)
    true = models.sgd(cosines_from_angles(*angles)[0], published("sgd")[2])
    scales = np.array([1.0, 1.15, 1.66]) / 1500.0
    found = planes[:, i, j, k].T * scales
    above = (planes[:, i, j, k] >= 0.0).T
    assert above.all(axis=1).sum() > 6
    off = np.abs(found[above] / true.reshape(found.shape)[above] - 1.0).max()
    record.at_most("values in the file times the scales of the format, over the BRDF at the cells, less 1", off, 1e-6)


@pytest.mark.check(16)
def test_cells_are_spaced_by_the_square_root_and_negative_ones_are_no_values(record: Record) -> None:
    theta_h = np.rad2deg(cell_angles()[0])
    index = np.floor(np.sqrt(theta_h / 90.0) * 90.0)
    record.at_most("cells of θ_h that the format's rule puts elsewhere", np.sum(index != np.arange(90)), 0)
    stored = np.full((3, *SHAPE), -1.0)
    stored[:, 5, 6, 7:9] = 300.0, 600.0
    mean, n_measured = MerlBrdf(stored).average()
    off = np.abs(mean[:, 5, 6] / (450.0 * np.array([1.0, 1.15, 1.66]) / 1500.0) - 1.0).max()
    record.at_most("mean over a row of 2 measured and 178 negative cells, over that of the 2, less 1", off, 1e-9)
    record.at_most("rows of negative cells that have a value", np.isfinite(mean).sum() - 3, 0)
    assert n_measured.sum() == 6


@pytest.mark.check(19)
def test_the_brdf_is_less_certain_where_nobody_saw_it(record: Record) -> None:
    material = next(atom for atom in from_published("sgd").atoms if atom.name == "gold-paint")
    seen = np.deg2rad(np.linspace(1.0, 35.0, 40))
    curve = atoms_on_slice((material,), seen)[0]
    completed = complete_brdf(seen, curve, 0.02 * curve, without("sgd", material.name))
    angle = np.rad2deg(THETA_H)
    inside, beyond = (
        completed.log_sigma[where, 0] for where in ((angle > 2) & (angle < 33), (angle > 50) & (angle < 75))
    )
    record.at_least(
        "sigma of the BRDF beyond the largest half angle seen over that within",
        np.median(beyond) / np.median(inside),
        2.0,
    )
    z = np.abs(np.log(completed.value / atom_on_nodes(material)) / completed.log_sigma)
    z = z[np.ix_(angle < 75.0, np.rad2deg(THETA_D) <= 60.0)]
    record.at_least(
        "share of the true BRDF of a material that the dictionary lacks within two of these sigmas",
        np.mean(z < 2.0),
        0.9,
    )


@pytest.mark.check(19)
def test_what_was_seen_is_kept_with_each_pixel_and_few_views_are_less_certain(record: Record) -> None:
    whole = make_stack(n_views=40, size=12)
    tilt = np.rad2deg(np.arccos(whole.camera_position[:, 2] / np.linalg.norm(whole.camera_position, axis=1)))
    near = with_views(whole, np.flatnonzero(tilt < 32.0))
    few = with_views(whole, np.arange(1, 40, 3))
    options = Options(palette="off", accuracy="draft", light="given")
    fits = {name: reconstruct(s, options).fits for name, s in (("whole", whole), ("near", near), ("few", few))}
    normal = whole.truth.normals.reshape(-1, 1, 3)
    to_camera = near.camera_position - whole.grid.points(whole.truth.depth).reshape(-1, 1, 3)
    cosine = np.sum(normal * to_camera, axis=-1) / np.linalg.norm(to_camera, axis=-1)
    true = np.rad2deg(np.arccos(cosine.min(axis=1)))
    off = np.abs(np.rad2deg(fits["near"].theta_h_range[:, 1]) - true)
    record.at_most(
        "largest half angle seen, as stored, less the true one, 95 % of the pixels", np.percentile(off, 95), 0.5, "°"
    )
    for name, text in (("few", "a third of the views"), ("near", "views within 32° only")):
        ratio = np.median(fits[name].normal_sigma / fits["whole"].normal_sigma)
        record.at_least(f"sigma of the normals with {text} over that with all", ratio, 1.2)
