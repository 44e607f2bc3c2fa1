import numpy as np
import pytest

from analysis.reflectance.atoms import Atom, TabulatedAtom
from analysis.reflectance.completion import (
    THETA_D,
    THETA_H,
    CompletedBrdf,
    atom_on_nodes,
    atoms_on_slice,
    complete_brdf,
    node_cosines,
)
from analysis.reflectance.dictionary import Dictionary, from_published, parametric
from analysis.reflectance.models import Cosines
from benchmarks.studies.beyond_slice import ESTIMATORS, Trial, regions, run, without

SEEN = np.deg2rad(np.linspace(1.0, 60.0, 65))
NODES_H_DEG, NODES_D_DEG = np.rad2deg(THETA_H), np.rad2deg(THETA_D)


def completed(
    atom: Atom, noise: float = 0.02, theta_h: np.ndarray = SEEN, dictionary: Dictionary | None = None
) -> CompletedBrdf:
    """Complete an atom's slice, without noise in the samples, against the SGD table."""
    curve = atoms_on_slice((atom,), theta_h)[0]
    return complete_brdf(theta_h, curve, noise * curve, dictionary or from_published("sgd"))


GOLD_PAINT = next(atom for atom in from_published("sgd").atoms if atom.name == "gold-paint")


def test_the_slice_table_of_an_atom_is_the_atom():
    np.testing.assert_allclose(
        atoms_on_slice((GOLD_PAINT,), SEEN)[0], GOLD_PAINT.evaluate(Cosines.on_slice(SEEN)), rtol=1e-3
    )


@pytest.mark.parametrize("name", ["gold-paint", "pvc", "red-fabric", "teflon"])
def test_a_material_of_the_dictionary_lies_within_the_band(name: str):
    atom = next(atom for atom in from_published("sgd").atoms if atom.name == name)
    result, truth = completed(atom), atom_on_nodes(atom)
    inner = np.ix_(NODES_H_DEG < 70.0, NODES_D_DEG <= 60.0)
    z = np.abs(np.log(result.value / truth) / result.log_sigma)[inner]
    assert np.mean(z < 1.0) > 0.6
    assert np.mean(z < 2.0) > 0.95


def test_what_was_seen_is_kept():
    """With a dictionary that lacks the material, on the piece of the slice that was seen."""
    others = without("sgd", GOLD_PAINT.name)
    result = completed(GOLD_PAINT, noise=0.01, dictionary=others)
    seen = (NODES_H_DEG >= 1.0) & (NODES_H_DEG <= 60.0)
    np.testing.assert_allclose(result.value[seen, 0], atom_on_nodes(GOLD_PAINT)[seen, 0], rtol=0.02)


@pytest.mark.parametrize("name", ["brass", "black-obsidian"])
def test_a_curve_that_the_dictionary_cannot_say_is_kept_where_it_was_seen(name: str):
    """What it misses on the slice is the material's own, so it holds beside the slice as well."""
    atom = next(atom for atom in from_published("sgd").atoms if atom.name == name)
    dense = np.deg2rad(np.linspace(0.0, np.sqrt(60.0), 100) ** 2)
    result = completed(atom, noise=0.01, theta_h=dense, dictionary=without("abc", name))
    error = np.abs(result.value / atom_on_nodes(atom) - 1.0)[NODES_H_DEG <= 60.0]
    assert np.median(error[:, 0]) < 1e-3
    # The dictionary alone is out by 90 and 140 %.
    assert np.sqrt(np.mean(error[:, :2] ** 2)) < 0.15


def test_a_lambertian_curve_stays_lambertian_except_where_the_band_is_wide():
    """A peak narrower than the smallest angle seen cannot be ruled out: white acrylic looks like this too."""
    result = completed(Atom("lambert"))
    near = np.ix_(NODES_H_DEG < 60.0, NODES_D_DEG <= 40.0)
    value, log_sigma = result.value[near], result.log_sigma[near]
    np.testing.assert_allclose(value[log_sigma < 0.05], 1.0 / np.pi, rtol=0.1)
    assert np.mean(log_sigma < 0.05) > 0.6
    assert np.abs(np.log(value * np.pi) / log_sigma).max() < 2.0
    assert log_sigma[0, 0] > 1.0


def test_the_result_scales_with_the_curve():
    """A capture knows the BRDF up to a factor only."""
    curve = atoms_on_slice((GOLD_PAINT,), SEEN)[0]
    one, many = (complete_brdf(SEEN, k * curve, 0.02 * k * curve, from_published("abc")) for k in (1.0, 730.0))
    np.testing.assert_allclose(many.value, 730.0 * one.value, rtol=1e-6)
    np.testing.assert_allclose(many.log_sigma, one.log_sigma, rtol=1e-6)


def test_the_order_of_the_samples_does_not_matter():
    curve = atoms_on_slice((GOLD_PAINT,), SEEN)[0]
    order = np.random.default_rng(2).permutation(len(SEEN))
    dictionary = from_published("abc")
    one = complete_brdf(SEEN, curve, 0.02 * curve, dictionary)
    other = complete_brdf(SEEN[order], curve[order], 0.02 * curve[order], dictionary)
    np.testing.assert_allclose(other.value, one.value, rtol=1e-6)


def test_the_band_widens_with_noise_and_with_what_was_not_seen():
    others = without("sgd", GOLD_PAINT.name)
    quiet = completed(GOLD_PAINT, 0.01, dictionary=others).log_sigma
    noisy = completed(GOLD_PAINT, 0.1, dictionary=others).log_sigma
    short = completed(GOLD_PAINT, 0.01, SEEN[:36], others).log_sigma
    assert np.mean(noisy) > np.mean(quiet)
    unseen = NODES_H_DEG > 50.0
    assert np.mean(short[unseen, 0]) > 2.0 * np.mean(quiet[unseen, 0])


def test_the_band_is_narrow_on_the_slice_and_wide_at_large_difference_angles():
    log_sigma = np.median(completed(GOLD_PAINT, dictionary=without("sgd", GOLD_PAINT.name)).log_sigma, axis=0)
    assert log_sigma[0] < 0.05
    assert log_sigma[NODES_D_DEG >= 60.0].min() > 0.3


def test_no_peak_grows_beyond_what_a_material_of_the_dictionary_does():
    """ABC knows no peak like brass's in SGD; left alone, the slope at 1 deg would go on to a thousandfold peak."""
    brass = next(atom for atom in from_published("sgd").atoms if atom.name == "brass")
    dictionary = from_published("abc")
    result = completed(brass, dictionary=dictionary)
    at_seen = np.interp(SEEN[0], THETA_H, result.value[:, 0])
    atoms = np.stack([atom_on_nodes(atom)[0, 0] for atom in dictionary.atoms])
    growth = atoms / np.array([np.interp(SEEN[0], THETA_H, atom_on_nodes(a)[:, 0]) for a in dictionary.atoms])
    assert result.value[0, 0] / at_seen < 1.5 * growth.max()


def test_samples_that_noise_took_below_zero_do_no_harm():
    curve = atoms_on_slice((GOLD_PAINT,), SEEN)[0]
    sigma = np.full_like(curve, 0.02 * np.median(curve))
    dark = np.where(np.arange(len(curve)) == 60, -sigma, curve)
    result = complete_brdf(SEEN, dark, sigma, from_published("sgd"))
    assert np.isfinite(result.value).all()
    assert np.all(result.value > 0.0)
    assert np.isfinite(result.log_sigma).all()


def test_tables_serve_as_materials_and_lobes_do_not():
    """A dictionary of tables of the SGD fits says what the fits say."""
    sgd = from_published("sgd").atoms[::3]
    theta_h, theta_d = THETA_H, THETA_D
    tables = tuple(TabulatedAtom(a.name, theta_h, theta_d, atom_on_nodes(a)) for a in sgd)
    of_models = completed(GOLD_PAINT, dictionary=Dictionary("models", sgd))
    of_tables = completed(GOLD_PAINT, dictionary=Dictionary("tables", (*parametric().atoms, *tables)))
    np.testing.assert_allclose(of_tables.value[:, :10], of_models.value[:, :10], rtol=0.1)


def test_the_estimate_becomes_an_atom():
    result = completed(GOLD_PAINT)
    atom = result.as_atom("found", 2)
    assert atom.label == "found / blue"
    np.testing.assert_allclose(atom.evaluate(node_cosines()), result.value, rtol=1e-9)


def test_between_tables_the_prior_beats_least_squares_and_its_band_holds_about_what_it_says():
    trial = Trial("sgd", "abc", 50.0, 0.05)
    region = regions(trial.largest_deg)["20-50"]
    error = {}
    for name in ("NNLS, by sigma", "Gaussian prior"):
        value, truth, log_sigma, _ = run(trial, ESTIMATORS[name], step=5)
        error[name] = np.median(np.abs(value / truth - 1.0)[:, region])
    assert error["Gaussian prior"] < 0.8 * error["NNLS, by sigma"]
    z = (np.abs(np.log(value / truth)) / log_sigma)[:, region]
    assert 0.55 < np.mean(z < 1.0) < 0.9
    assert np.mean(z < 1.96) > 0.75


def test_on_its_own_table_the_band_holds_at_least_what_it_says():
    value, truth, log_sigma, _ = run(Trial("sgd", "sgd", 70.0, 0.05), complete_brdf, step=5)
    for region in regions(70.0).values():
        z = (np.abs(np.log(value / truth)) / log_sigma)[:, region]
        assert np.mean(z < 1.0) > 0.68
        assert np.mean(z < 1.96) > 0.9


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"theta_h": SEEN[:-1]}, "must be rows of one length"),
        ({"theta_h": SEEN[:3], "curve": np.ones(3), "sigma": np.ones(3)}, "3 samples of the curve; at least 4"),
        ({"sigma": np.zeros(65)}, "sigma positive"),
        ({"curve": np.full(65, np.nan)}, "must be finite"),
        ({"theta_h": SEEN + 1.0}, r"goes from 1\.017 to 2\.047 rad; must be within 0 and pi / 2"),
        ({"theta_h": SEEN - 0.1}, r"goes from -0\.08255 to 0\.9472 rad; must be within 0 and pi / 2"),
        ({"curve": np.zeros(65)}, "nothing was seen of the BRDF"),
        ({"dictionary": parametric()}, "'parametric' has 0 atoms that are materials; more than 20 are needed"),
    ],
)
def test_what_is_no_curve_is_refused_with_the_reason(change: dict, message: str):
    arguments = {"theta_h": SEEN, "curve": np.ones(65), "sigma": np.ones(65), "dictionary": from_published("sgd")}
    with pytest.raises(ValueError, match=message):
        complete_brdf(**{**arguments, **change})
