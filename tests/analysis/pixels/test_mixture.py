from itertools import combinations

import numpy as np
import pytest
from scipy import optimize

from analysis.pixels.mixture import allocate_mixture, choose, refit
from analysis.pixels.nnls import MAX_ATOMS, nnls_work


def mix(column, y, w=None, tolerance=0.0, most=3):
    """Return the share of every material."""
    n_materials, n_rows = column.shape
    mixture, work = allocate_mixture(n_materials, n_rows), nnls_work(n_rows, 1)
    mixture.column[:] = column
    active, a = np.zeros(MAX_ATOMS, np.int64), np.zeros(MAX_ATOMS)
    m = choose(np.ones(n_rows) if w is None else w, y, tolerance, most, active, a, work, mixture)
    full = np.zeros(n_materials)
    full[active[:m]] = a[:m]
    np.testing.assert_array_equal(work.columns[:m], column[active[:m]])
    return full


def curves(seed: int, n_materials: int = 6, n_rows: int = 90):
    """Smooth columns that are much alike, as materials' are."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0.0, 1.0, n_rows)
    width = rng.uniform(0.1, 1.0, n_materials)
    return np.exp(-((t / width[:, None]) ** 2)) + rng.uniform(0.05, 0.5, (n_materials, 1))


@pytest.mark.parametrize("seed", range(12))
def test_two_materials_are_told_from_six_as_scipy_tells_them(seed: int):
    rng = np.random.default_rng(seed)
    column = curves(seed)
    share = np.zeros(6)
    share[rng.choice(6, 2, replace=False)] = rng.uniform(0.3, 1.0, 2)
    y = share @ column
    np.testing.assert_allclose(mix(column, y, tolerance=1e-12), optimize.nnls(column.T, y)[0], atol=1e-4)


@pytest.mark.parametrize("most", [1, 2, 3])
@pytest.mark.parametrize("seed", range(8))
def test_no_other_choice_of_as_many_materials_fits_better(seed: int, most: int):
    rng = np.random.default_rng(seed)
    column = curves(seed)
    y = rng.uniform(0.0, 1.0, 6) @ column + 0.02 * rng.standard_normal(90)
    ours = np.linalg.norm(mix(column, y, most=most) @ column - y)
    best = min(optimize.nnls(column[list(chosen)].T, y)[1] for chosen in combinations(range(6), most))
    assert ours == pytest.approx(best, rel=1e-6)


def test_weights_count_like_repeated_measurements():
    column = curves(3, n_materials=3)
    y = np.array([0.4, 0.0, 0.7]) @ column + 0.05 * np.random.default_rng(0).standard_normal(90)
    w = np.where(np.arange(90) < 20, 4.0, 1.0)
    root = np.sqrt(w)
    np.testing.assert_allclose(mix(column, y, w), optimize.nnls((column * root).T, y * root)[0], atol=1e-6)


def test_a_material_enters_only_if_it_pays():
    column = curves(5)
    y = column[0] + 1e-3 * column[4]
    paid = np.sum((y - column[0] * (y @ column[0]) / (column[0] @ column[0])) ** 2)
    assert np.count_nonzero(mix(column, y, tolerance=1.1 * paid)) == 1
    assert np.count_nonzero(mix(column, y, tolerance=1e-3 * paid)) > 1


def test_a_copy_of_a_material_is_not_taken_beside_it():
    column = np.repeat(curves(9, n_materials=1), 3, axis=0)
    share = mix(column, 2.0 * column[0])
    assert np.count_nonzero(share) == 1
    assert share.sum() == pytest.approx(2.0)


def test_a_black_pixel_is_made_of_nothing():
    assert not mix(curves(11), np.zeros(90), tolerance=1e-9).any()


@pytest.mark.parametrize("seed", range(6))
def test_refitting_the_materials_in_use_is_what_scipy_finds_for_them(seed: int):
    column = curves(seed, n_materials=3)
    y = np.random.default_rng(seed).uniform(-0.3, 1.0, 3) @ column
    work = nnls_work(90, 1)
    work.columns[:3] = column
    active, a = np.zeros(MAX_ATOMS, np.int64), np.zeros(MAX_ATOMS)
    active[:3], a[:3] = [0, 1, 2], 1.0
    m = refit(np.ones(90), y, 3, active, a, work)
    found = a[:m] @ column[active[:m]] - y
    assert np.linalg.norm(found) <= 1.05 * optimize.nnls(column.T, y)[1] + 1e-6
