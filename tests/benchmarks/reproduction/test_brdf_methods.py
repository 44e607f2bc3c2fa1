from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest

from analysis.reflectance.models import Cosines, cosines_from_angles
from benchmarks.reproduction.brdf_domain import LOWEST_ELEVATION_DEG, Domain
from benchmarks.reproduction.brdf_materials import Collection, fitted
from benchmarks.reproduction.brdf_methods import xu2016
from benchmarks.reproduction.brdf_methods.case import (
    BIVARIATE,
    DOMAIN,
    FULL,
    N_SAMPLES,
    UNIVARIATE,
    Case,
    cases,
    sampled_places,
)
from benchmarks.reproduction.brdf_methods.dictionary_fit import coefficients, from_samples_at
from benchmarks.reproduction.brdf_methods.ngan2005 import by_solid_angle, cook_torrance_lobe, fit, ward_lobe
from benchmarks.reproduction.brdf_methods.romeiro2008 import bivariate_model
from benchmarks.reproduction.brdf_methods.univariate import completed
from benchmarks.reproduction.brdf_methods.xu2016 import (
    N_DIRECTIONS,
    LogRelativeBasis,
    choose_directions,
    directions,
    optimised,
)
from benchmarks.reproduction.slice_models import COOK_TORRANCE, WARD

WHOLE = Domain.whole()
COSINES = cosines_from_angles(WHOLE.angles.theta_h, WHOLE.angles.theta_d, WHOLE.angles.phi_d)[0]
RNG = np.random.default_rng(4)


@pytest.fixture(scope="module", autouse=True)
def few_candidates() -> Iterator[None]:
    """Choose among fewer directions, for speed."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(xu2016, "N_CANDIDATES", 90)
        yield


@pytest.fixture(scope="module")
def case() -> Case:
    """Give one glossy material against the other table."""
    collection = fitted("sgd", "abc")
    tested = tuple(m for m in collection.tested if m.name == "gold-paint")
    return next(cases(replace(collection, tested=tested), WHOLE, seed=0))


def test_all_places_that_are_sampled_lie_above_the_horizon_as_the_domain_has_it():
    for angles in sampled_places(np.random.default_rng(1)).values():
        assert len(angles) == N_SAMPLES
        assert np.minimum(*angles.n_dot_l_and_v).min() > np.sin(np.deg2rad(LOWEST_ELEVATION_DEG)) - 1e-9


@pytest.mark.parametrize("place", [FULL, BIVARIATE, UNIVARIATE])
def test_a_material_within_the_span_of_the_dictionary_is_found_exactly(case: Case, place: str):
    atoms = case.atoms(place)[:, [0, 40, 200]]
    mixture = np.array([[0.2, 1.0], [3.0, 0.0], [0.0, 0.5]])
    np.testing.assert_allclose(coefficients(atoms, atoms @ mixture), mixture, atol=1e-9)


def test_full_sampling_finds_a_material_that_the_dictionary_has():
    collection = fitted("sgd", "sgd")
    own = Collection("own", (replace(collection.tested[40], name="another"),), collection.known, collection.dictionary)
    with_itself = next(cases(own, WHOLE, seed=0))
    estimate = from_samples_at(FULL)(with_itself)
    assert WHOLE.relative_error(estimate, with_itself.samples(DOMAIN)) < 1e-3


def test_the_bivariate_model_is_the_mean_over_phi_d_and_nothing_else(case: Case):
    model, truth = bivariate_model(case), case.samples(DOMAIN)
    for i_h, i_d in ((5, 3), (30, 8)):
        cell = (WHOLE.i_h == i_h) & (WHOLE.i_d == i_d)
        np.testing.assert_allclose(model[cell], np.broadcast_to(truth[cell].mean(axis=0), model[cell].shape))


@pytest.mark.parametrize("m", [0.02, 0.13, 0.5])
def test_a_cook_torrance_material_is_recovered_by_its_fit(m: float):
    shape = np.array([np.log(m), 0.17])
    diffuse, specular = np.array([0.3, 0.1, 0.02]), np.array([0.2, 0.4, 0.4])
    truth = diffuse / np.pi + specular * cook_torrance_lobe(COSINES, shape)[:, None]
    for weight in (WHOLE.weight, by_solid_angle(WHOLE)):
        found = fit(WHOLE, cook_torrance_lobe, truth, weight)
        assert WHOLE.relative_error(found.value, truth) < 2e-3
        assert np.exp(found.shape[0]) == pytest.approx(m, rel=2e-3)


def test_a_ward_material_is_recovered_by_its_fit():
    truth = 0.2 / np.pi + np.array([0.1, 0.2, 0.3]) * ward_lobe(COSINES, np.array([np.log(0.17)]))[:, None]
    found = fit(WHOLE, ward_lobe, truth, by_solid_angle(WHOLE))
    np.testing.assert_allclose(found.diffuse, 0.2, rtol=1e-3)
    np.testing.assert_allclose(found.specular, [0.1, 0.2, 0.3], rtol=1e-3)
    assert np.exp(found.shape[0]) == pytest.approx(0.17, rel=1e-3)


def test_no_strength_of_a_fit_is_negative(case: Case):
    dark_centre = np.maximum(0.3 - 0.2 * ward_lobe(COSINES, np.array([np.log(0.4)])), 0.0)[:, None] * np.ones(3)
    found = fit(WHOLE, ward_lobe, dark_centre, WHOLE.weight)
    assert (found.specular == 0.0).all()
    assert (found.diffuse > 0.0).all()


def test_the_fit_as_scored_is_the_best_of_its_model(case: Case):
    truth = case.samples(DOMAIN)
    as_scored, by_angle = (
        fit(WHOLE, cook_torrance_lobe, truth, weight) for weight in (WHOLE.weight, by_solid_angle(WHOLE))
    )
    assert WHOLE.relative_error(as_scored.value, truth) <= WHOLE.relative_error(by_angle.value, truth)


@pytest.mark.parametrize(("lobe", "model"), [(cook_torrance_lobe, COOK_TORRANCE), (ward_lobe, WARD)])
def test_lobes_are_those_whose_parameters_the_slice_gives(lobe, model):
    theta_h = np.deg2rad([0.0, 10.0, 30.0, 60.0, 80.0])
    on_slice = lobe(Cosines.on_slice(theta_h), np.array([np.log(0.3), 1.0]))
    np.testing.assert_allclose(on_slice, model.evaluate(np.cos(theta_h), np.array([0.0, 1.0, 0.3])), rtol=1e-9)


def test_the_basis_gives_its_atoms_back_from_all_directions():
    atoms = RNG.lognormal(-2.0, 1.0, (60, 8))
    basis = LogRelativeBasis.from_atoms(atoms, RNG.uniform(0.1, 1.0, 60))
    np.testing.assert_allclose(basis.estimate(np.arange(60), atoms, eta=1e-9), atoms, rtol=1e-6)


def test_ridge_over_components_is_what_the_estimate_does():
    atoms, weight = RNG.lognormal(-2.0, 1.0, (60, 8)), RNG.uniform(0.1, 1.0, 60)
    basis, nodes = LogRelativeBasis.from_atoms(atoms, weight), np.array([3, 17, 40, 41, 59])
    sample = RNG.lognormal(-2.0, 1.0, (60, 1))
    Q = basis.scaled_components(8)
    x = np.log((sample * weight[:, None] + 1e-3) / (basis.median * weight + 1e-3)[:, None])[:, 0] - basis.mean
    c = np.linalg.solve(Q[nodes].T @ Q[nodes] + 2.0 * np.eye(8), Q[nodes].T @ x[nodes])
    expected = (np.exp(basis.mean + Q @ c) * (basis.median * weight + 1e-3) - 1e-3) / weight
    np.testing.assert_allclose(
        basis.estimate(nodes, sample[nodes], eta=2.0)[:, 0], np.maximum(expected, 0.0), atol=1e-9
    )


def test_chosen_directions_are_better_conditioned_than_any_of_many_at_random(case: Case):
    nodes = directions(case.bank, WHOLE)
    assert len(set(nodes.tolist())) == N_DIRECTIONS
    atoms, (n_l, n_v) = case.bank.atoms(DOMAIN), WHOLE.angles.n_dot_l_and_v
    Q = LogRelativeBasis.from_atoms(atoms, n_l * n_v).scaled_components(N_DIRECTIONS)
    random = [np.linalg.cond(Q[RNG.choice(len(Q), N_DIRECTIONS, replace=False)]) for _ in range(200)]
    assert np.linalg.cond(Q[nodes]) < min(random)


def test_directions_that_span_a_basis_of_few_are_found():
    Q = np.vstack([np.eye(3), np.full((40, 3), 0.5) + 0.01 * RNG.standard_normal((40, 3))])
    assert choose_directions(Q, 3, np.arange(43)).tolist() == [0, 1, 2]


def test_few_optimised_directions_do_as_well_as_many_at_random(case: Case):
    truth = case.samples(DOMAIN)
    few = WHOLE.log_error(optimised(case), truth)
    assert few < WHOLE.log_error(from_samples_at(FULL)(case), truth)


def test_the_slice_is_kept_by_its_completion(case: Case):
    near = WHOLE.up_to(0.0)
    assert WHOLE.relative_error(completed(case), case.samples(DOMAIN), near) < 0.01
