import numpy as np
import pytest
from scipy import optimize

from analysis.pixels.nnls import MAX_ATOMS, nnls, nnls_work
from analysis.reflectance.dictionary import parametric
from analysis.reflectance.models import Cosines


def fit(phi, y, w=None, tolerance=0.0, most=MAX_ATOMS, warm=((), ())):
    """Return the coefficient of every column; `warm` = indices and coefficients to go on from."""
    n_views, n_atoms = phi.shape
    active, a = np.zeros(MAX_ATOMS, np.int64), np.zeros(MAX_ATOMS)
    m = len(warm[0])
    active[:m], a[:m] = warm
    w = np.ones(n_views) if w is None else w
    m = nnls(phi.astype(np.float32), w, y, tolerance, most, m, active, a, nnls_work(n_views, n_atoms))
    full = np.zeros(n_atoms)
    full[active[:m]] = a[:m]
    return full


def residual(phi, a, y):
    return float(np.linalg.norm(phi.astype(np.float32).astype(np.float64) @ a - y))


def well_posed(seed: int, n_active: int = 3, n_atoms: int = 12):
    rng = np.random.default_rng(seed)
    phi = np.abs(rng.standard_normal((40, n_atoms))).astype(np.float32)
    a = np.zeros(n_atoms)
    a[rng.choice(n_atoms, n_active, replace=False)] = rng.uniform(0.5, 2.0, n_active)
    return phi, phi @ a + 0.01 * rng.standard_normal(40)


@pytest.mark.parametrize("seed", range(12))
def test_the_residual_is_as_small_as_that_of_scipy(seed: int):
    phi, y = well_posed(seed)
    best, norm = optimize.nnls(phi.astype(np.float64), y)
    ours = fit(phi, y)
    if np.count_nonzero(best) <= MAX_ATOMS:
        assert residual(phi, ours, y) == pytest.approx(norm, rel=1e-6)
    else:
        assert residual(phi, ours, y) < 1.1 * norm


@pytest.mark.parametrize("seed", range(6))
def test_the_coefficients_are_those_of_scipy_when_few_columns_can_serve(seed: int):
    phi, y = well_posed(seed, n_active=2, n_atoms=5)
    best, _ = optimize.nnls(phi.astype(np.float64), y)
    np.testing.assert_allclose(fit(phi, y), best, atol=1e-6)


def test_weights_count_like_repeated_measurements():
    phi, y = well_posed(1, n_atoms=5)
    w = np.ones(40)
    w[:10] = 4.0
    root = np.sqrt(w)
    best, _ = optimize.nnls(phi * root[:, None], y * root)
    np.testing.assert_allclose(fit(phi, y, w), best, atol=1e-6)


@pytest.mark.parametrize("seed", range(10))
def test_no_coefficient_is_negative_whatever_the_data(seed: int):
    rng = np.random.default_rng(seed)
    a = fit(rng.standard_normal((20, 15)), rng.standard_normal(20))
    assert a.min() >= 0.0
    assert np.count_nonzero(a) <= MAX_ATOMS


def test_data_that_only_a_negative_coefficient_would_fit_get_none():
    phi, _ = well_posed(0)
    assert not fit(phi, -phi[:, 3].astype(np.float64)).any()


def test_a_warm_start_gives_the_cold_answer():
    phi, y = well_posed(3, n_active=2, n_atoms=6)
    cold = fit(phi, y)
    wrong = np.flatnonzero(cold == 0.0)[:2]
    np.testing.assert_allclose(fit(phi, y, warm=(wrong, np.ones(len(wrong)))), cold, atol=1e-6)
    right = np.flatnonzero(cold)
    np.testing.assert_allclose(fit(phi, y, warm=(right, cold[right])), cold, atol=1e-9)


def test_a_duplicate_column_leaves_the_fit_as_it_was():
    phi, y = well_posed(4)
    twice = np.concatenate([phi, phi], axis=1)
    assert residual(twice, fit(twice, y), y) == pytest.approx(residual(phi, fit(phi, y), y), rel=1e-6)


def test_columns_that_differ_by_a_millionth_do_not_blow_up():
    rng = np.random.default_rng(5)
    phi, y = well_posed(5)
    nearly = np.concatenate([phi, phi * (1.0 + 1e-6 * rng.standard_normal(phi.shape))], axis=1)
    a = fit(nearly, y)
    assert np.isfinite(a).all()
    assert a.sum() < 10.0
    assert residual(nearly, a, y) <= 1.001 * residual(phi, fit(phi, y), y)


@pytest.mark.parametrize("k", range(0, 52, 4))
def test_a_curve_that_is_one_atom_of_the_dictionary_is_found_as_that_atom(k: int):
    """Although its neighbours are nearly parallel: the ill-conditioned case of every day."""
    phi = parametric().evaluate(Cosines.on_slice(np.linspace(0.02, 1.1, 65)))
    phi = (phi / np.sqrt(np.mean(phi**2, axis=0))).astype(np.float32)
    a = fit(phi, 2.0 * phi[:, k].astype(np.float64), tolerance=1e-6)
    assert a[k] == pytest.approx(2.0, abs=1e-3)
    assert a.sum() == pytest.approx(2.0, abs=1e-3)


def test_an_atom_that_gains_less_than_the_tolerance_is_not_used():
    phi, y = well_posed(6, n_active=1)
    full = fit(phi, y)
    sparse = fit(phi, y, tolerance=0.1)
    assert np.count_nonzero(sparse) == 1
    assert np.count_nonzero(full) > 1


def test_no_more_atoms_are_used_than_asked_for():
    phi, y = well_posed(8, n_active=5)
    assert np.count_nonzero(fit(phi, y, most=2)) == 2


def test_a_column_of_zeros_is_never_used():
    phi, y = well_posed(7)
    phi[:, 2] = 0.0
    assert fit(phi, y)[2] == 0.0
