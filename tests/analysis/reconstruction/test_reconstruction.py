from dataclasses import replace

import numpy as np
import pytest

from analysis.evaluation.metrics import angular_error_deg, depth_rmse
from analysis.evaluation.scoring import score, truth_error
from analysis.light.offset import estimate_light_offset
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import Reconstruction, reconstruct
from analysis.reflectance.dictionary import parametric
from analysis.registration.lighting import LightOffset, light_position, looking_at_centre
from analysis.registration.stack import Stack
from analysis.stages import Stages
from tests.analysis.conftest import NOISE
from tests.synthetic import make_stack

OFFSET = (12.0, -5.0, 0.0)


def error_deg(result: Reconstruction) -> np.ndarray:
    return angular_error_deg(result.normals, result.stack.truth.normals)


def choices(result: Reconstruction) -> dict[str, tuple[str, str]]:
    return {choice.effect: (choice.chosen, choice.reason) for choice in result.choices}


@pytest.fixture(scope="module")
def offset_stack() -> Stack:
    return make_stack(n_views=40, size=20, light_offset=OFFSET)


def collocated(stack: Stack) -> Stack:
    return replace(stack, light_position=stack.camera_position)


@pytest.fixture(scope="module")
def estimated(offset_stack: Stack) -> Reconstruction:
    """From a stack that says that the light is in the lens."""
    return reconstruct(collocated(offset_stack), Options(light="estimate", accuracy="draft"))


def test_depth_comes_within_a_hundredth_of_a_millimetre(reconstruction: Reconstruction):
    assert depth_rmse(reconstruction.depth, reconstruction.stack.truth.depth) < 0.01
    assert np.mean(reconstruction.depth) == pytest.approx(0.0, abs=1e-9)


def test_normals_come_within_a_tenth_of_a_degree(reconstruction: Reconstruction):
    assert error_deg(reconstruction).mean() < 0.12


def test_the_stated_sigma_of_depth_is_of_the_size_of_its_error(reconstruction: Reconstruction):
    error = reconstruction.depth - reconstruction.stack.truth.depth
    ratio = np.std(error) / np.sqrt(np.mean(reconstruction.depth_sigma**2))
    assert 0.3 < ratio < 5.0


def test_every_choice_is_recorded_with_its_reason(reconstruction: Reconstruction):
    made = choices(reconstruction)
    effects = {"light", "dictionary", "field", "palette", "light power", "relative error", "parallax", "depth updates"}
    assert set(made) == effects | {"neighbours", "sigma"}
    assert made["light"] == ("collocated", "0.00 mm from the lens, as the stack says")
    assert all(reason for _, reason in made.values())
    assert reconstruction.choices[0].effect == "light"


def test_the_stages_are_timed(stack: Stack):
    announced: list[str] = []
    stages = Stages(announced.append)
    reconstruct(stack, Options(accuracy="draft"), stages)
    assert set(announced) == {"noise and light", "palette", "normals and BRDF", "neighbours", "depth"}
    assert {stage.name for stage in stages} == set(announced)
    assert all(stage.seconds > 0.0 and stage.peak_mb > 0.0 for stage in stages)


@pytest.mark.parametrize("accuracy", ["draft", "best"])
def test_the_other_accuracies_give_depth_too(stack: Stack, accuracy: str):
    result = reconstruct(stack, Options(accuracy=accuracy))
    assert depth_rmse(result.depth, stack.truth.depth) < 0.01


def test_the_same_seed_gives_the_same_bits(stack: Stack):
    one, two = (reconstruct(stack, Options(accuracy="draft", threads=n)) for n in (1, 2))
    np.testing.assert_array_equal(one.normals, two.normals)
    np.testing.assert_array_equal(one.depth, two.depth)
    np.testing.assert_array_equal(one.depth_sigma, two.depth_sigma)


def test_independent_pixels_have_normals_but_no_depth(stack: Stack):
    for result in (
        reconstruct(stack, Options(independent=True)),
        reconstruct(replace(stack, pixels="independent")),
    ):
        assert np.isnan(result.depth).all()
        assert error_deg(result).mean() < 0.2
        assert choices(result)["depth"][0] == "off"


def test_a_stack_without_variance_is_reconstructed_from_its_own_residuals(stack: Stack):
    result = reconstruct(replace(stack, variance=None), Options(accuracy="draft"))
    assert error_deg(result).mean() < 0.2


def test_a_sample_with_holes_has_depth_around_them(stack: Stack):
    radiance = stack.radiance.copy()
    radiance[:, 8:12, 8:12] = np.nan
    result = reconstruct(replace(stack, radiance=radiance))
    np.testing.assert_array_equal(np.isnan(result.depth), np.isnan(radiance[0, ..., 0]))
    assert depth_rmse(result.depth, stack.truth.depth) < 0.01


def test_the_offset_of_the_light_is_found_from_the_highlights(estimated: Reconstruction):
    found = estimated.light_offset
    np.testing.assert_allclose(found.value[:2], OFFSET[:2], atol=0.7)
    assert np.all((found.sigma[:2] > 0.0) & (found.sigma[:2] < 3.0))
    assert "highlights put it at" in choices(estimated)["light"][1]


@pytest.mark.slow
def test_an_offset_light_taken_for_collocated_is_much_worse(offset_stack: Stack, estimated: Reconstruction):
    given = reconstruct(offset_stack, Options(accuracy="draft"))
    forced = reconstruct(offset_stack, Options(light="collocated", accuracy="draft"))
    assert choices(forced)["light"] == ("collocated", "forced by option")
    assert choices(given)["light"][0] == "offset"
    assert error_deg(forced).mean() > 4.0 * error_deg(given).mean()
    assert error_deg(estimated).mean() < 0.5 * error_deg(forced).mean()


def test_an_uncertain_light_is_refined_from_the_highlights():
    stack = make_stack(n_views=30, size=16, light_offset=OFFSET)
    wrong = np.array([10.0, -3.0, 0.0])
    uncertain = replace(
        stack,
        light_position=light_position(stack, wrong),
        light_offset=wrong,
        light_offset_sigma=np.full(3, 3.0),
    )
    result = reconstruct(uncertain)
    np.testing.assert_allclose(result.light_offset.value[:2], OFFSET[:2], atol=0.7)
    assert np.array_equal(result.stack.light_offset, result.light_offset.value)


def test_a_sigma_without_an_offset_refines_nothing(stack: Stack):
    result = reconstruct(replace(stack, light_offset_sigma=np.ones(3)))
    assert result.light_offset is None
    assert choices(result)["light"][0] == "collocated"


def test_a_certain_prior_keeps_the_light_where_the_ruler_put_it(offset_stack: Stack):
    ruler = LightOffset(np.array([10.0, -5.0, 0.0]), np.full(3, 1e-4))
    found = estimate_light_offset(offset_stack, parametric(), NOISE, ruler, np.random.default_rng(0))
    np.testing.assert_allclose(found.value, ruler.value, atol=0.05)


def test_an_offset_without_a_camera_frame_is_refused(stack: Stack):
    with pytest.raises(ValueError, match="no camera_rotation"):
        light_position(replace(stack, camera_rotation=None), np.zeros(3))


def test_a_camera_that_looks_at_the_centre_has_it_straight_ahead(stack: Stack):
    rotation = looking_at_centre(stack.camera_position)
    ahead = np.einsum("nij,nj->ni", rotation, -stack.camera_position)
    np.testing.assert_allclose(ahead[:, :2], 0.0, atol=1e-9)
    assert np.all(ahead[:, 2] > 0.0)
    np.testing.assert_allclose(np.linalg.det(rotation), 1.0)


def test_the_score_tells_the_error_against_the_truth(reconstruction: Reconstruction):
    summary = score(reconstruction, n_held_out=2, n_pixels=100)
    error = truth_error(reconstruction)
    assert error is not None
    assert summary.normal_error_deg.mean == pytest.approx(error.mean())
    assert summary.depth_rmse_mm == pytest.approx(depth_rmse(reconstruction.depth, reconstruction.stack.truth.depth))
    assert 0.5 < summary.coverage68 < 0.9
    assert summary.coverage68 < summary.coverage95 <= 1.0
    assert summary.n_unsolved == 0
    assert [view.view for view in summary.left_out] == [10, 30]


def test_without_a_truth_there_is_no_error_to_tell(reconstruction: Reconstruction):
    blind = replace(reconstruction, stack=replace(reconstruction.stack, truth=None))
    assert truth_error(blind) is None
    assert score(blind, n_held_out=0).normal_error_deg is None
