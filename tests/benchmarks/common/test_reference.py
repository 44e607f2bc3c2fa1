"""The reference method: candidates from coarse to fine, plain NNLS at each."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.evaluation.metrics import angular_error_deg
from analysis.reflectance.atoms import Atom
from analysis.reflectance.dictionary import Dictionary, from_published
from analysis.reflectance.models import Cosines
from benchmarks.common.methods import METHODS
from benchmarks.common.reference import (
    CAP_DEG,
    FINEST_SPACING_DEG,
    FIRST_SPACING_DEG,
    PixelSamples,
    atom_table,
    first_candidates,
    neighbours,
    solve_pixel,
)
from benchmarks.common.scenes import cap, independent


def samples_of(atom: Atom, normal: np.ndarray, n_views: int = 40) -> PixelSamples:
    """What a collocated rig sees of a pixel of one atom, in three channels of different level, without noise."""
    omega = cap(n_views, np.random.default_rng(0))
    c = np.clip(omega @ normal, 0.0, 1.0)
    y = (atom.evaluate(Cosines.on_slice(np.arccos(c))) * c)[:, None] * np.array([1.0, 0.5, 2.0])
    return PixelSamples(omega, omega, y, np.full_like(y, 100.0 / y.max()))


@pytest.mark.parametrize("material", [0, 30, 61])
def test_the_normal_of_a_material_of_the_dictionary_is_found_to_the_grid(material: int) -> None:
    normal = np.array([0.21, -0.34, 1.0])
    normal /= np.linalg.norm(normal)
    few = Dictionary("few", (*from_published("abc").atoms[::15], Atom("abc", material, 1)))
    found = solve_pixel(samples_of(Atom("abc", material, 1), normal), atom_table(few))
    assert angular_error_deg(found.normal, normal) < FINEST_SPACING_DEG
    assert 340 <= found.n_problems <= 400


def test_the_first_candidates_leave_no_hole_in_the_cap() -> None:
    grid = first_candidates()
    rng = np.random.default_rng(1)
    z = 1.0 - (1.0 - np.cos(np.deg2rad(CAP_DEG - FIRST_SPACING_DEG))) * rng.random(500)
    azimuth = 2.0 * np.pi * rng.random(500)
    s = np.sqrt(1.0 - z * z)
    inside = np.stack([s * np.cos(azimuth), s * np.sin(azimuth), z], axis=1)
    nearest = np.rad2deg(np.arccos(np.clip(np.max(inside @ grid.T, axis=1), -1.0, 1.0)))
    assert nearest.max() < 0.7 * FIRST_SPACING_DEG
    assert np.linalg.norm(grid, axis=1) == pytest.approx(1.0)


def test_neighbours_lie_in_a_ring_about_a_normal() -> None:
    normal = np.array([0.6, 0.0, 0.8])
    ring = neighbours(normal, 0.01)
    assert ring.shape == (6, 3)
    assert np.arccos(ring @ normal) == pytest.approx(0.01, rel=1e-6)
    assert ring.mean(axis=0) == pytest.approx(np.cos(0.01) * normal)


def test_a_pixel_does_not_see_its_own_material() -> None:
    scene = independent(2, 12, 0.01, seed=3)
    seen = METHODS["reference"](scene)
    names = [atom.name for atom in from_published("abc").atoms]
    left_out = {name for pixel in scene.weight.argmax(axis=1) for name in [scene.names[pixel]]}
    assert left_out <= set(names)
    assert np.isfinite(seen.normals).all()
    assert np.isnan(seen.sigma).all()
