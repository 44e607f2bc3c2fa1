"""What a view tells, against the model's own finite differences and against a cloud of estimates."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from drivers.simulated.rendering.brdf import evaluate
from drivers.simulated.rendering.materials import Microfacet, table
from instrument.config.loading import load_rig
from instrument.config.protocol import ChosenConfig
from protocols.poses.information import Cases, expected_cases, gradient, information_vectors, prior_information
from protocols.poses.rough_material import PARAMETERS, brdf, radiance

RIG = load_rig(Path(__file__).parents[3] / "examples" / "simulated.toml")
DISTANCE = RIG.geometry.working_distance_mm


@pytest.fixture(scope="module")
def cases() -> Cases:
    return expected_cases(RIG, ChosenConfig(count=1))


def places(n: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(0)
    lens = np.column_stack([rng.uniform(-250.0, 250.0, (n, 2)), rng.uniform(200.0, 350.0, n)])
    return lens, lens + rng.uniform(-15.0, 15.0, (n, 3))


def test_the_gradient_equals_finite_differences_of_the_radiance(cases: Cases) -> None:
    to_lens, to_light = (place[:, None] - cases.point for place in places(6))
    exact, step = gradient(cases, to_lens, to_light, DISTANCE), 1e-5
    for i in range(len(PARAMETERS)):
        shift = step * (np.arange(len(PARAMETERS)) == i)
        above, below = (
            radiance(cases.unknowns + sign * shift, cases.frame, to_lens, to_light, DISTANCE) for sign in (1, -1)
        )
        difference = (above - below).real / (2.0 * step)
        np.testing.assert_allclose(exact[..., i], difference, rtol=1e-5, atol=1e-7 * np.abs(difference).max())


def test_the_information_bounds_what_a_fit_to_noisy_radiances_scatters(cases: Cases) -> None:
    # A linear fit of many draws about one case: its covariance is the inverse of the information.
    lens, light = places(40)
    u = information_vectors(cases, lens, light, DISTANCE)[7]
    M = prior_information() + u.T @ u
    rng = np.random.default_rng(1)
    prior = rng.standard_normal((20000, 5)) @ np.sqrt(prior_information())
    estimates = (rng.standard_normal((20000, 40)) @ u + prior) @ np.linalg.inv(M)
    np.testing.assert_allclose(np.cov(estimates.T).diagonal(), np.linalg.inv(M).diagonal(), rtol=0.05)


def test_a_white_matte_plate_that_faces_the_light_has_radiance_1() -> None:
    matte = np.array([[0.0, 0.0, 0.0, -30.0, 0.0]])
    above = np.array([[[0.0, 0.0, DISTANCE]]])
    assert radiance(matte, np.eye(3)[None], above, above, DISTANCE) == pytest.approx(1.0, abs=1e-6)


def test_the_brdf_is_that_of_the_simulated_rig_but_for_its_base() -> None:
    rng = np.random.default_rng(2)
    omega_i, omega_o = rng.standard_normal((2, 50, 3))
    omega_i, omega_o = (w / np.linalg.norm(w, axis=1, keepdims=True) for w in (omega_i, omega_o))
    omega_i[:, 2], omega_o[:, 2] = np.abs(omega_i[:, 2]) + 0.05, np.abs(omega_o[:, 2]) + 0.05
    omega_i, omega_o = (w / np.linalg.norm(w, axis=1, keepdims=True) for w in (omega_i, omega_o))
    h = (omega_i + omega_o) / np.linalg.norm(omega_i + omega_o, axis=1, keepdims=True)
    bare = np.log([1e-30, 0.3, 0.2])
    ours = brdf(bare, omega_i[:, 2], omega_o[:, 2], h[:, 2], np.sum(omega_o * h, axis=1))
    row = table((Microfacet("bare", (0.0, 0.0, 0.0), (0.3, 0.3, 0.3), 0.2),))
    np.testing.assert_allclose(ours, evaluate(row, 0, omega_i, omega_o)[:, 0], rtol=1e-9)


def test_a_view_that_is_close_to_edge_on_tells_nothing_and_one_from_behind_neither(cases: Cases) -> None:
    to_side = np.array([[350.0, 0.0, 20.0], [0.0, 0.0, -350.0], [0.0, 0.0, 350.0]])
    u = information_vectors(cases, to_side, to_side, DISTANCE)
    assert np.isfinite(u).all()
    tilted = cases.frame[:, 2, 0] < 0.0  # away from the first place
    assert (u[tilted, 0] == 0.0).all()
    assert (u[:, 1] == 0.0).all()
    assert (u[:, 2] != 0.0).any(axis=-1).all()


def test_a_frame_turned_in_its_plane_tells_the_same_of_the_normal(cases: Cases) -> None:
    lens, light = places(12)
    turned = np.array([[0.6, 0.8, 0.0], [-0.8, 0.6, 0.0], [0.0, 0.0, 1.0]]) @ cases.frame
    traces = []
    for frame in (cases.frame, turned):
        u = information_vectors(Cases(cases.unknowns, frame, cases.point, cases.loss), lens, light, DISTANCE)
        C = np.linalg.inv(prior_information() + np.swapaxes(u, 1, 2) @ u)
        traces.append(np.einsum("kij,kji->k", cases.loss, C))
    np.testing.assert_allclose(traces[0], traces[1], rtol=1e-7)
