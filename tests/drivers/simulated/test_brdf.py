import math

import numpy as np
import pytest

from drivers.simulated.rendering import materials
from drivers.simulated.rendering.brdf import evaluate
from drivers.simulated.rendering.materials import Material, OrenNayar

MATERIALS = (
    materials.TEAL_PAINT,
    materials.GOLD,
    materials.SATIN_PLASTIC,
    materials.TERRACOTTA,
    materials.LACQUER,
    materials.RED_FABRIC,
    materials.WHITE_PAPER,
)
each_material = pytest.mark.parametrize("material", MATERIALS, ids=lambda material: material.name)


def hemisphere(rng: np.random.Generator, n: int) -> np.ndarray:
    """Return unit vectors, shape (n, 3), with density cos(theta) / pi."""
    share, phi = rng.random(n), 2.0 * np.pi * rng.random(n)
    r = np.sqrt(share)
    return np.stack([r * np.cos(phi), r * np.sin(phi), np.sqrt(1.0 - share)], axis=-1)


def f(material: Material, omega_i: np.ndarray, omega_o: np.ndarray) -> np.ndarray:
    return evaluate(materials.table((material,)), 0, omega_i, omega_o)


@each_material
def test_light_and_camera_may_change_places(material: Material):
    rng = np.random.default_rng(1)
    omega_i, omega_o = hemisphere(rng, 500), hemisphere(rng, 500)
    np.testing.assert_allclose(f(material, omega_i, omega_o), f(material, omega_o, omega_i), rtol=1e-9)


@each_material
def test_turning_both_directions_about_the_normal_changes_nothing(material: Material):
    rng = np.random.default_rng(2)
    omega_i, omega_o = hemisphere(rng, 200), hemisphere(rng, 200)
    c, s = math.cos(1.1), math.sin(1.1)
    turn = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    np.testing.assert_allclose(f(material, omega_i @ turn, omega_o @ turn), f(material, omega_i, omega_o), rtol=1e-7)


@each_material
@pytest.mark.parametrize("theta_deg", [0.0, 45.0, 75.0, 88.0])
def test_no_more_light_leaves_than_arrives(material: Material, theta_deg: float):
    theta = math.radians(theta_deg)
    omega_i = hemisphere(np.random.default_rng(3), 40_000)
    omega_o = np.tile([math.sin(theta), 0.0, math.cos(theta)], (len(omega_i), 1))
    directional_albedo = np.pi * f(material, omega_i, omega_o).mean(axis=0)
    assert np.all(directional_albedo <= 1.0)
    assert np.all(directional_albedo >= 0.0)


@each_material
def test_nothing_is_reflected_below_the_surface(material: Material):
    up, down = np.array([[0.0, 0.6, 0.8]]), np.array([[0.0, 0.6, -0.8]])
    assert np.all(f(material, up, down) == 0.0)
    assert np.all(f(material, down, up) == 0.0)


def test_a_flat_oren_nayar_surface_is_lambert():
    rng = np.random.default_rng(4)
    lambert = OrenNayar("chalk", (0.3, 0.5, 0.9), 0.0)
    expected = np.tile(np.array([0.3, 0.5, 0.9]) / np.pi, (100, 1))
    np.testing.assert_allclose(f(lambert, hemisphere(rng, 100), hemisphere(rng, 100)), expected)


def test_a_rough_conductor_has_the_closed_form_of_its_peak():
    up = np.array([[0.0, 0.0, 1.0]])
    # D = 1 / (pi alpha^2), G = 1, F = F0, over 4.
    np.testing.assert_allclose(f(materials.GOLD, up, up)[0], np.array(materials.GOLD.f0) / (4.0 * np.pi * 0.2**2))
