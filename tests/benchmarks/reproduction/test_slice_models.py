import numpy as np
import pytest

from benchmarks.reproduction.experiments.identifiability import CASES, IDEAL, Case, recovered
from benchmarks.reproduction.slice_models import ASHIKHMIN_SHIRLEY, BLINN_PHONG, MODELS, WARD, SliceModel, closed_form

by_name = pytest.mark.parametrize("model", MODELS, ids=lambda model: model.name)


@by_name
@pytest.mark.parametrize("case", IDEAL, ids=lambda case: case.name)
def test_without_noise_the_parameters_come_back_exactly(model: SliceModel, case: Case):
    found = recovered(model, case, 0.0, np.random.default_rng(0))
    for parameters in found.values():
        np.testing.assert_allclose(parameters, case.parameters(model), rtol=1e-9)


@by_name
def test_with_noise_they_come_back_nearly(model: SliceModel):
    found = recovered(model, CASES[0], 0.01, np.random.default_rng(2))
    for parameters in found.values():
        np.testing.assert_allclose(parameters, CASES[0].parameters(model), rtol=0.05)


@by_name
def test_a_lobe_that_no_sample_shows_does_not_come_back(model: SliceModel):
    hidden = next(case for case in CASES if "from 4 deg" in case.name)
    found = recovered(model, hidden, 0.01, np.random.default_rng(0))
    error = np.abs(found["closed form"] / hidden.parameters(model) - 1.0)
    assert not np.max(np.nan_to_num(error, nan=1.0)) < 0.1


def test_blinn_phong_and_ashikhmin_shirley_are_as_published():
    c = np.cos(np.deg2rad([0.0, 20.0, 70.0]))
    np.testing.assert_allclose(
        BLINN_PHONG.evaluate(c, np.array([0.1, 0.3, 12.0])), 0.1 + 0.3 * 14.0 / (2.0 * np.pi) * c**12
    )
    diffuse = 28.0 * 0.1 / (23.0 * np.pi) * (1.0 - 0.3) * (1.0 - (1.0 - c / 2.0) ** 5) ** 2
    specular = 13.0 / (8.0 * np.pi) * c**12 / c * 0.3
    np.testing.assert_allclose(ASHIKHMIN_SHIRLEY.evaluate(c, np.array([0.1, 0.3, 12.0])), diffuse + specular)


def test_the_line_of_ward_falls_by_one_over_beta_squared():
    c = np.cos(np.linspace(0.0, 0.6, 20))
    x, y = WARD.line(c, WARD.evaluate(c, np.array([0.1, 0.2, 0.25])), 0.1)
    slope, intercept = np.polyfit(x, y, 1)
    assert slope == pytest.approx(-1.0 / 0.25**2)
    assert intercept == pytest.approx(np.log(0.2 / (4.0 * np.pi * 0.25**2)))


def test_a_matte_surface_has_no_line():
    theta_h = np.linspace(0.0, 1.5, 50)
    assert np.isnan(closed_form(WARD, theta_h, np.full(50, 0.2), 0.01)).all()
