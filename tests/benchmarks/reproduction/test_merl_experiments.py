from pathlib import Path

import numpy as np
import pytest

from analysis.reflectance.atoms import published
from benchmarks.reproduction.brdf_domain import BANDS_DEG
from benchmarks.reproduction.experiment import Experiment, Finding, Request, Row, Verdict
from benchmarks.reproduction.experiments import baseline, identifiability, images, methods, slices, spheres
from benchmarks.reproduction.stand_in import likeness, worst
from tests.merl_files import write_materials


def test_likeness_is_not_comparable_where_two_fits_of_one_material_are_not_alike_either():
    assert likeness(0.6, 0.1) is Verdict.EQUAL
    assert likeness(0.4, 0.9) is Verdict.WORSE
    assert likeness(0.4, 0.1) is Verdict.NOT_COMPARABLE
    assert likeness(0.4, None) is Verdict.WORSE
    assert worst([Verdict.EQUAL, Verdict.NOT_COMPARABLE]) is Verdict.NOT_COMPARABLE


def test_competitive_means_no_worse_than_every_parametric_fit_on_all_materials():
    def summary(ours: float, other: float) -> list[Row]:
        errors = dict.fromkeys(methods.PARAMETRIC, 0.3) | {"Ward (Ngan 2005)": other, methods.OURS: ours}
        return [
            {"materials": source, "method": name, "relative_to_45_deg": error}
            for source in ("a", "b")
            for name, error in errors.items()
        ]

    assert methods.is_competitive(summary(0.2, 0.2))
    assert not methods.is_competitive(summary(0.2, 0.19))


def test_stable_ends_before_the_first_error_that_is_too_large():
    errors = np.full(len(baseline.THETAS_DEG), 0.1)
    assert baseline.stable_to_deg(errors) == baseline.THETAS_DEG[-1]
    errors[[9, 12]] = 0.21
    assert baseline.stable_to_deg(errors) == baseline.THETAS_DEG[8]


def test_steepness_is_the_power_that_errors_fall_with():
    counts = np.array(images.COUNTS, float)
    rows = [
        {"materials": "a", "what": images.NORMAL, "n_images": n, "mean": e}
        for n, e in zip(counts, 3.0 * counts**-0.7, strict=True)
    ]
    assert images.steepness(rows, "a", images.NORMAL, "mean") == pytest.approx(0.7)


def test_half_angles_are_one_in_each_step():
    theta_h = images.half_angles(10, np.random.default_rng(0))
    steps = np.floor(np.sqrt(theta_h / np.deg2rad(80.0)) * 10)
    assert steps.tolist() == list(range(10))


def test_curves_are_normalised_by_the_range_of_the_truth():
    truth = np.linspace(1.0, 3.0, 11)[:, None] * np.array([1.0, 10.0])
    assert slices.normalised_rmse(truth + 0.1 * np.array([2.0, 20.0]), truth) == pytest.approx(0.1)
    flat = np.hstack([truth, np.full((11, 1), 5.0)])
    assert slices.normalised_rmse(flat + 1.0, flat) == pytest.approx(slices.normalised_rmse(truth + 1.0, truth))
    assert np.isnan(slices.normalised_rmse(flat[:, 2:], flat[:, 2:]))


@pytest.mark.parametrize("theta_d_deg", spheres.LIGHTS_DEG)
def test_a_sphere_has_the_half_and_difference_angles_of_its_light(theta_d_deg: float):
    sphere = spheres.Sphere.under(np.deg2rad(theta_d_deg))
    n_dot_l, n_dot_v = sphere.angles.n_dot_l_and_v
    axis = (np.arange(spheres.N_PIXELS) + 0.5) / spheres.N_PIXELS * 2.0 - 1.0
    z = np.sqrt(np.maximum(1.0 - axis**2 - axis[:, None] ** 2, 0.0))
    np.testing.assert_allclose(n_dot_l, sphere.n_dot_l, atol=1e-7)
    np.testing.assert_allclose(n_dot_v, z[sphere.lit], atol=1e-7)


def test_a_lambertian_sphere_is_as_bright_as_its_cosine():
    sphere = spheres.Sphere.under(0.0)
    picture = sphere.picture(np.ones((len(sphere.angles), 3)))
    middle = spheres.N_PIXELS // 2
    assert picture[middle, middle] == pytest.approx(1.0, abs=1e-3)
    assert (picture[0, 0] == 0.0).all()


ALL = (identifiability, images, slices, baseline, spheres, methods)


def check(experiment: Experiment, finding: Finding) -> None:
    """What every finding must be."""
    assert finding.rows
    assert all(row.keys() == finding.rows[0].keys() for row in finding.rows)
    assert finding.ours
    assert finding.why
    for figure in finding.figures:
        assert figure.is_file()
        assert 2_000 < figure.stat().st_size < 150_000


@pytest.mark.slow
@pytest.mark.parametrize("module", ALL, ids=lambda module: module.EXPERIMENT.name)
def test_an_experiment_of_few_materials_is_a_whole_finding_and_repeats(
    module, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(module, "QUICK_MATERIALS", 3, raising=False)
    monkeypatch.setattr(module, "N_DRAWS_QUICK", 2, raising=False)
    monkeypatch.setattr(module, "QUICK", images.Size(3, 4, 1, 1), raising=False)
    monkeypatch.setattr(module, "SHOWN", ("teflon",), raising=False)
    first, second = (module.EXPERIMENT.run(Request(tmp_path / name, quick=True, seed=3)) for name in ("a", "b"))
    check(module.EXPERIMENT, first)
    for one, other in zip(first.rows, second.rows, strict=True):
        timeless = {key: value for key, value in one.items() if "seconds" not in key}
        assert timeless == {key: value for key, value in other.items() if "seconds" not in key}


@pytest.mark.slow
def test_measured_files_go_the_same_way(tmp_path: Path):
    names = [str(name) for name in published("sgd")["name"][: 9 * 10 : 10]]
    folder = write_materials(tmp_path / "merl", **{name.replace("-", "_"): 10 * i for i, name in enumerate(names)})
    finding = methods.EXPERIMENT.run(Request(tmp_path, quick=True, seed=0, merl=folder))
    check(methods.EXPERIMENT, finding)
    assert finding.rows[0]["n_materials"] == 9
    assert "9 MERL files" in finding.ours
    last = f"relative_{BANDS_DEG[-1][0]:.0f}_{BANDS_DEG[-1][1]:.0f}_deg"
    assert all(np.isfinite(row[last]) for row in finding.rows)
