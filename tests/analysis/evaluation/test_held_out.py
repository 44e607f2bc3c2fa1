import numpy as np
import pytest

from analysis.evaluation.held_out import glossy_pixels, hold_out
from analysis.reconstruction.reconstruction import Reconstruction
from analysis.results.summary import HeldOutView

ALL = np.arange(576)


@pytest.fixture(scope="module")
def left_out(reconstruction: Reconstruction) -> tuple[HeldOutView, ...]:
    return hold_out(reconstruction, np.array([6, 20]), ALL)


def test_held_out_views_are_predicted_to_a_few_percent(left_out: tuple[HeldOutView, ...]):
    for view in left_out:
        assert view.n_pixels == 576
        assert view.relative_rms < 0.05


def test_on_glossy_pixels_the_dictionary_beats_lambert_by_six_decibels(left_out: tuple[HeldOutView, ...]):
    for view in left_out:
        assert view.n_glossy > 50
        assert view.glossy_gain_db >= 6.0
        assert view.relative_rms < view.lambert_relative_rms
        assert view.psnr_db > view.lambert_psnr_db


def test_glossy_are_the_pixels_of_the_glossy_stripes(reconstruction: Reconstruction):
    glossy = glossy_pixels(reconstruction.fits)
    material = reconstruction.stack.truth.material.ravel()
    assert not glossy[material == 0].any()
    assert glossy[material == 2].mean() > 0.8


def test_a_view_that_was_left_out_is_predicted_less_well_than_one_that_was_fitted(
    reconstruction: Reconstruction, left_out: tuple[HeldOutView, ...]
):
    """Else the view was not left out at all."""
    stack, view = reconstruction.stack, left_out[0].view
    points = stack.grid.points(reconstruction.depth).reshape(-1, 3)
    fitted = reconstruction.fits.radiance(points, stack.camera_position[view], stack.light_position[view])
    measured = stack.radiance[view].reshape(-1, 3)
    in_sample = np.sqrt(np.sum((fitted - measured) ** 2) / np.sum(measured**2))
    assert left_out[0].relative_rms > in_sample
