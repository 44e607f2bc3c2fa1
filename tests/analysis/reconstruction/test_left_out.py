from dataclasses import replace

import numpy as np
import pytest

from analysis.evaluation.metrics import angular_error_deg
from analysis.evaluation.scoring import score
from analysis.reconstruction.left_out import best_gain, error_with_gain
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import Reconstruction, reconstruct
from tests.analysis.few_views.phone import OFFSET_MM, phone


@pytest.fixture(scope="module")
def solved() -> Reconstruction:
    return reconstruct(phone(40).stack, Options(accuracy="draft", palette="colour"))


def chosen(reconstruction: Reconstruction) -> dict[str, str]:
    return {choice.effect: choice.chosen for choice in reconstruction.choices}


def test_materials_by_colour_are_recorded_with_the_powers_that_were_found(solved: Reconstruction):
    assert "by colour" in chosen(solved)["palette"]
    assert chosen(solved)["light power"] == "per view"


@pytest.mark.slow
def test_whichever_materials_predict_better_have_the_powers_and_the_light_that_were_found():
    """Of these pictures a palette of solved pixels does, once it knows them: without, its normals are 2 deg off."""
    taken = phone(40)
    found = reconstruct(taken.stack, Options(accuracy="draft"))
    assert chosen(found)["light"] == "offset"
    assert chosen(found)["light power"] == "per view"
    assert "light power, refined" in chosen(found)
    assert np.std(np.log(found.stack.light_power) - taken.log_power) < 0.03
    assert angular_error_deg(found.normals.reshape(-1, 3), taken.normals).mean() < 0.7


def test_the_light_that_nobody_stated_is_found_with_them(solved: Reconstruction):
    assert solved.light_offset is not None
    assert np.linalg.norm(solved.light_offset.value[:2] - [OFFSET_MM, 0.0]) < 6.0
    assert solved.stack.light_offset is not None


def test_what_the_light_may_be_off_is_in_the_sigma_of_the_normals(solved: Reconstruction):
    assert np.rad2deg(np.nanmedian(solved.fits.normal_sigma)) > 0.3


def test_views_left_out_are_solved_without_them_and_scored_with_and_without_a_gain(solved: Reconstruction):
    summary = score(solved, n_held_out=2)
    for view in summary.left_out:
        assert view.relative_rms_with_gain is not None
        assert view.relative_rms_with_gain < 1.1 * view.relative_rms
        assert view.relative_rms < view.lambert_relative_rms
    assert summary.n_materials == solved.few_views.state.n_materials


def test_a_light_that_is_given_is_left_where_it_is():
    found = reconstruct(phone(24).stack, Options(palette="colour", light="given", power="given", accuracy="draft"))
    assert found.light_offset is None
    assert chosen(found)["light power"] == "given"


def test_the_gain_is_that_of_the_typical_bright_sample():
    rng = np.random.default_rng(0)
    told = rng.uniform(0.01, 1.0, (200, 3))
    measured = 1.3 * told
    measured[:20] = 9.0  # a highlight that was not foretold
    measured[50] = np.nan
    assert best_gain(told, measured) == pytest.approx(1.3)
    assert error_with_gain(told, 1.3 * told) == pytest.approx(0.0, abs=1e-12)
    assert error_with_gain(np.full((3, 3), np.nan), np.ones((3, 3))) == np.inf
    assert best_gain(np.full((3, 3), np.nan), np.ones((3, 3))) == 1.0


def test_a_binned_stack_has_the_means_of_its_squares():
    stack = phone(24).stack
    binned = stack.binned(5)
    assert binned.radiance.shape == (7, 4, 4, 3)
    assert binned.pixel_pitch == pytest.approx(5 * stack.pixel_pitch)
    np.testing.assert_allclose(binned.radiance[2, 1, 3], stack.radiance[2, 5:10, 15:20].mean(axis=(0, 1)), rtol=1e-5)
    np.testing.assert_allclose(
        binned.variance[2, 1, 3], stack.variance[2, 5:10, 15:20].mean(axis=(0, 1)) / 25.0, rtol=1e-5
    )
    assert binned.saturated[2, 1, 3, 0] == stack.saturated[2, 5:10, 15:20, 0].max()
    radiance = stack.radiance.copy()
    radiance[0, 6, 6] = np.nan
    assert np.isnan(replace(stack, radiance=radiance).binned(5).radiance[0, 1, 1]).all()
