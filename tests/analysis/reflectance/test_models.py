import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from analysis.reflectance.dictionary import MODELS, from_published, parametric
from analysis.reflectance.models import GRAZING, Cosines, fresnel_dielectric, lobe, lobe_alpha, roll_off

Z = np.array([0.0, 0.0, 1.0])
EXAMPLES = {
    "lobe": (0.1, 2.0),
    "roll_off": (1.0, 0.1),
    "sgd": (17.0, 1.0),
    "abc": (17.0, 1.0),
}
each_model = pytest.mark.parametrize("model", sorted(MODELS))


def direction(cos_theta: float, phi: float) -> np.ndarray:
    sine = np.sqrt(1.0 - cos_theta**2)
    return np.array([sine * np.cos(phi), sine * np.sin(phi), cos_theta])


upper = st.builds(direction, st.floats(0.02, 1.0), st.floats(0.0, 2.0 * np.pi))


def evaluate(model: str, omega_i: np.ndarray, omega_o: np.ndarray) -> float:
    a, b = EXAMPLES.get(model, (0.0, 0.0))
    return float(MODELS[model](Cosines.from_directions(Z, omega_i, omega_o), a, b))


@each_model
@given(omega_i=upper, omega_o=upper)
def test_light_and_camera_may_change_places(model: str, omega_i: np.ndarray, omega_o: np.ndarray):
    assert evaluate(model, omega_i, omega_o) == pytest.approx(evaluate(model, omega_o, omega_i), rel=1e-9)


@each_model
@given(omega_i=upper, omega_o=upper)
def test_no_model_reflects_less_than_nothing(model: str, omega_i: np.ndarray, omega_o: np.ndarray):
    assert evaluate(model, omega_i, omega_o) >= 0.0


@each_model
@given(omega=upper)
def test_the_slice_is_the_model_at_coinciding_directions(model: str, omega: np.ndarray):
    a, b = EXAMPLES.get(model, (0.0, 0.0))
    on_slice = MODELS[model](Cosines.on_slice(np.arccos(omega[2])), a, b)
    assert evaluate(model, omega, omega) == pytest.approx(float(on_slice), rel=1e-6)


@each_model
def test_turning_light_and_camera_about_the_normal_changes_nothing(model: str):
    omega_i, omega_o = direction(0.8, 0.3), direction(0.5, 2.0)
    turned = evaluate(model, direction(0.8, 1.6), direction(0.5, 3.3))
    assert evaluate(model, omega_i, omega_o) == pytest.approx(turned, rel=1e-9)


@pytest.mark.parametrize("half_width_deg", [0.7, 5.0, 38.0])
@pytest.mark.parametrize("gamma", [1.0, 2.0, 6.0])
def test_a_lobe_has_half_its_peak_at_its_half_width(half_width_deg: float, gamma: float):
    half_width = np.deg2rad(half_width_deg)
    peak, half = lobe(Cosines.on_slice(np.array([0.0, half_width])), half_width, gamma)
    assert peak == pytest.approx(1.0)
    assert half == pytest.approx(0.5)


def test_a_lobe_of_exponent_two_is_the_trowbridge_reitz_distribution():
    theta = np.linspace(0.0, 1.4, 50)
    alpha = lobe_alpha(0.2, 2.0)
    ggx = (alpha**2 / (np.cos(theta) ** 2 * (alpha**2 - 1.0) + 1.0)) ** 2
    np.testing.assert_allclose(lobe(Cosines.on_slice(theta), 0.2, 2.0), ggx, rtol=1e-9)


def test_a_roll_off_is_halfway_down_at_its_angle():
    value = roll_off(Cosines.on_slice(np.array([0.0, 1.0])), 1.0, 0.05)
    np.testing.assert_allclose(value, [1.0 / np.pi, 0.5 / np.pi], rtol=1e-6)


def test_a_dielectric_reflects_four_percent_at_index_one_and_a_half_and_everything_edge_on():
    np.testing.assert_allclose(fresnel_dielectric(np.array([1.0, 0.0]), 1.5), [0.04, 1.0], rtol=1e-9)


def test_edge_on_directions_are_clipped_so_that_nothing_is_divided_by_zero():
    edge = np.array([1.0, 0.0, 0.0])
    cosines = Cosines.from_directions(Z, edge, Z)
    assert cosines.n_dot_l == GRAZING
    for model in MODELS:
        assert np.isfinite(evaluate(model, edge, edge))


@pytest.mark.parametrize(
    "dictionary", [parametric(), from_published("sgd"), from_published("abc")], ids=lambda d: d.name
)
def test_every_atom_is_finite_and_not_negative_on_the_slice(dictionary):
    value = dictionary.evaluate(Cosines.on_slice(np.linspace(0.0, np.pi / 2, 200)))
    assert value.shape == (200, len(dictionary.atoms))
    assert np.isfinite(value).all()
    assert value.min() >= 0.0
