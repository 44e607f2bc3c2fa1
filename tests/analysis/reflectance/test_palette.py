from dataclasses import replace

import numpy as np
import pytest

from analysis.evaluation.metrics import angular_error_deg
from analysis.palette.joint_step import KNOTS, N_KNOTS
from analysis.palette.materials import leading_material, materials_used
from analysis.palette.search import PaletteFit, PaletteSearch, find_palette, loss_of
from analysis.pixels.fits import PixelFits
from analysis.pixels.problem import Noise, PixelProblem
from analysis.reconstruction.effects import far_field
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import Reconstruction, reconstruct
from analysis.reflectance.dictionary import Dictionary, TabulatedAtom, parametric
from analysis.reflectance.models import Cosines
from analysis.reflectance.palette import MAX_MATERIALS, NODES, Palette
from analysis.registration.stack import Stack
from tests.synthetic import brdf, make_stack

NOISE = Noise(relative=1e-3, floor=0.0)


def true_palette() -> Palette:
    """Matte, satin and glossy of the synthetic sample, on the slice."""
    c = 1.0 - NODES**2
    w = np.stack([np.sqrt(1.0 - c**2), np.zeros_like(c), c], axis=-1)
    n = np.broadcast_to([0.0, 0.0, 1.0], w.shape)
    return Palette(np.stack([brdf(n, w, w, np.full(len(c), k)).T for k in range(3)]))


def problem(stack: Stack) -> PixelProblem:
    return PixelProblem(stack, parametric(), depth=stack.truth.depth)


def error_deg(fits: PixelFits, stack: Stack) -> np.ndarray:
    return angular_error_deg(fits.normals, stack.truth.normals.reshape(-1, 3))


@pytest.fixture(scope="module")
def own(stack: Stack) -> PixelFits:
    return problem(stack).solve(NOISE)


@pytest.fixture(scope="module")
def found(stack: Stack, own: PixelFits) -> PaletteFit:
    return find_palette(problem(stack), own, NOISE, np.random.default_rng(0))


@pytest.fixture(scope="module")
def known(stack: Stack) -> PixelFits:
    """With the true curves given: as good as it gets."""
    return problem(stack).solve_with_palette(true_palette(), NOISE)


def test_a_known_palette_beats_pixels_on_their_own(stack: Stack, own: PixelFits, known: PixelFits):
    assert error_deg(known, stack).mean() < 0.9 * error_deg(own, stack).mean()


def test_a_known_palette_names_each_pixels_material(stack: Stack, known: PixelFits):
    first = materials_used(known)[:, 0]
    assert np.mean(first == stack.truth.material.ravel()) > 0.95


def test_the_palette_that_is_found_is_nearly_as_good_as_the_true_one(
    stack: Stack, own: PixelFits, known: PixelFits, found: PaletteFit
):
    assert error_deg(found.fits, stack).mean() < 0.97 * error_deg(own, stack).mean()
    assert error_deg(found.fits, stack).mean() < 1.25 * error_deg(known, stack).mean()


def test_few_materials_are_found_where_there_are_three(found: PaletteFit):
    assert 2 <= found.palette.n_materials <= 5


def test_a_pixel_mixes_few_materials_with_shares_that_are_not_negative(found: PaletteFit):
    assert np.all((materials_used(found.fits) >= 0).sum(axis=1) <= MAX_MATERIALS)
    assert np.all(found.fits.coefficient >= 0.0)


def test_the_curves_are_those_of_the_sample_where_it_was_seen(stack: Stack, found: PaletteFit):
    theta = np.broadcast_to(np.deg2rad([10.0, 25.0, 40.0]), (stack.truth.material.size, 3))
    w = np.stack([np.sin(theta), 0 * theta, np.cos(theta)], axis=-1)
    n = np.broadcast_to([0.0, 0.0, 1.0], w.shape)
    material = np.broadcast_to(stack.truth.material.reshape(-1, 1), theta.shape)
    ratio = found.fits.brdf(Cosines.on_slice(theta)) / brdf(n, w, w, material)
    assert np.median(np.abs(ratio - 1.0)) < 0.01


def test_no_joint_step_raises_the_loss(stack: Stack, own: PixelFits):
    search = PaletteSearch(problem(stack), own, NOISE)
    state = search.solve(search.candidates(np.arange(len(own.normals)), 4))
    after = search.step(state)
    assert after.loss < state.loss


def test_the_reduced_system_is_the_curvature_of_the_fitted_chi_square(stack: Stack, known: PixelFits):
    """Gradient of chi-square to the curves, normals and shares refitted, against finite differences of it."""
    # Plain chi-square: the step holds the robust weights fixed, a difference would not.
    pixels = np.flatnonzero(stack.truth.material.ravel() == 2)[:60]
    part = problem(stack).select(pixels)
    palette = true_palette()
    fits = part.solve_with_palette(palette, NOISE, start=known.normals[pixels], cold=False)
    state = PaletteFit(palette, fits, 0.0, 0.0, np.zeros((3, 3, N_KNOTS)))
    search = PaletteSearch(part, fits, NOISE)
    _, rhs = search.system(state)
    place, step = (2 * 3 + 1) * N_KNOTS + 12, 2e-4

    def chi2(change: float) -> float:
        curve = palette.curve.copy()
        hat = np.interp(NODES, KNOTS, np.eye(N_KNOTS)[12])
        curve[2, 1] *= np.exp(change * hat)
        moved = part.solve_with_palette(Palette(curve), NOISE, start=fits.normals, cold=False)
        model, samples = part.model(moved), part.samples
        variance = samples.variance + (NOISE.relative * model) ** 2
        return float(np.sum((samples.radiance - model) ** 2 / variance))

    slope = (chi2(step) - chi2(-step)) / (2.0 * step)
    assert rhs[place] == pytest.approx(-0.5 * slope, rel=0.2)


def test_shares_double_and_normals_stay_where_the_sample_is_twice_as_bright(stack: Stack, known: PixelFits):
    bright = replace(stack, radiance=2 * stack.radiance, variance=4 * stack.variance)
    twice = problem(bright).solve_with_palette(true_palette(), NOISE)
    assert np.percentile(angular_error_deg(twice.normals, known.normals), 99) < 1e-3
    np.testing.assert_allclose(twice.coefficient.sum(axis=2), 2 * known.coefficient.sum(axis=2), rtol=1e-3)


def test_the_loss_is_the_mean_logarithm_of_one_plus_the_pixels(found: PaletteFit):
    assert found.loss == pytest.approx(np.nanmean(np.log1p(found.fits.loss)))
    assert loss_of(found.fits).shape == found.fits.loss.shape


def choice(result: Reconstruction, effect: str) -> str:
    return next(c.chosen for c in result.choices if c.effect == effect)


@pytest.fixture(scope="module")
def reconstructed(stack: Stack) -> Reconstruction:
    return reconstruct(stack, Options(palette="on"))


def test_a_reconstruction_says_how_many_materials_it_found(reconstructed: Reconstruction):
    assert choice(reconstructed, "palette").endswith("materials")
    assert reconstructed.palette is not None
    assert reconstructed.fits.dictionary.name == "palette"


def test_each_material_has_a_band_that_widens_where_it_was_not_seen(reconstructed: Reconstruction):
    materials = reconstructed.materials
    seen = (materials.theta_h > materials.seen[0, 0]) & (materials.theta_h < materials.seen[0, 1])
    band = materials.log_sigma[0, 0]
    assert np.median(band[seen, 0]) < 0.05
    assert np.median(band[seen, -1]) > 3.0 * np.median(band[seen, 0])
    assert np.all(np.isfinite(band) & (band > 0.0))


def test_materials_beyond_the_slice_are_their_curves_on_it(reconstructed: Reconstruction):
    materials, palette = reconstructed.materials, reconstructed.palette.found.palette
    theta = np.linspace(*materials.seen[0], 20)
    on_slice = np.interp(np.sqrt(1.0 - np.cos(theta)), NODES, palette.curve[0, 0])
    np.testing.assert_allclose(materials.atoms[0].evaluate(Cosines.on_slice(theta)), on_slice, rtol=0.01)


def test_pixels_of_a_palette_are_the_same_for_any_number_of_threads(stack: Stack):
    one, two = (reconstruct(stack, Options(palette="on", threads=n)) for n in (1, 2))
    np.testing.assert_array_equal(one.normals, two.normals)
    np.testing.assert_array_equal(one.depth, two.depth)


@pytest.mark.slow
def test_the_size_of_the_tiles_does_not_matter(
    stack: Stack, reconstructed: Reconstruction, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr("analysis.pixels.problem._MAX_CHUNK", 100)
    monkeypatch.setattr("analysis.pixels.problem.TILE", 150)
    small = reconstruct(stack, Options(palette="on"))
    np.testing.assert_array_equal(small.normals, reconstructed.normals)
    np.testing.assert_array_equal(small.depth, reconstructed.depth)


@pytest.mark.slow
def test_views_of_wrong_power_are_corrected_where_the_palette_says_so(stack: Stack):
    factor = 1.0 + 0.03 * np.random.default_rng(2).standard_normal(stack.n_views)
    wrong = replace(stack, light_power=stack.light_power * factor)
    estimated = reconstruct(wrong, Options(palette="on"))
    given = reconstruct(wrong, Options(palette="on", power="given"))
    assert choice(estimated, "light power") == "per view"
    assert choice(given, "light power") == "given"
    truth = stack.truth.normals
    assert angular_error_deg(estimated.normals, truth).mean() < 0.7 * angular_error_deg(given.normals, truth).mean()


def test_right_powers_are_left_alone(reconstructed: Reconstruction):
    assert choice(reconstructed, "light power") == "given"


def test_a_power_to_estimate_without_a_palette_is_left_with_the_reason(stack: Stack):
    result = reconstruct(stack, Options(palette="off", power="estimate", accuracy="draft"))
    power = next(c for c in result.choices if c.effect == "light power")
    assert power.chosen == "given"
    assert "without a palette" in power.reason


def test_a_palette_forced_on_a_black_sample_is_left_with_the_reason():
    stack = make_stack(n_views=12, size=24)
    black = replace(stack, radiance=np.zeros_like(stack.radiance), variance=np.full_like(stack.variance, 1e-6))
    result = reconstruct(black, Options(palette="on", accuracy="draft"))
    palette = next(c for c in result.choices if c.effect == "palette")
    assert palette.chosen == "off"
    assert "fewer than 20 pixels" in palette.reason
    assert np.isnan(result.normals).all()


@pytest.mark.slow
def test_a_view_that_sees_nothing_keeps_its_power(stack: Stack):
    radiance = stack.radiance.copy()
    radiance[7] = np.nan
    result = reconstruct(replace(stack, radiance=radiance), Options(palette="on", power="estimate", accuracy="draft"))
    assert np.isfinite(result.stack.light_power).all()


def test_a_measured_material_beside_the_palette_is_none_of_its_materials(found: PaletteFit):
    """A pixel that stands on its own may use tables of a measured dictionary."""
    steel = TabulatedAtom("steel", np.array([0.0, 1.0]), np.zeros(1), np.ones((2, 1)))
    own = replace(found.fits.select(np.array([0])), dictionary=Dictionary("measured", (steel,)))
    own = replace(own, atom=np.where(np.arange(own.atom.shape[2]) == 0, 0, -1) * np.ones_like(own.atom))
    mixed = found.fits.replaced(np.array([5]), own)
    assert leading_material(mixed)[5] == -1
    assert leading_material(mixed)[4] == leading_material(found.fits)[4]


def test_independent_pixels_share_no_palette(stack: Stack):
    result = reconstruct(replace(stack, pixels="independent"))
    assert choice(result, "palette") == "off"


def test_a_distant_rig_is_seen_to_need_no_near_field():
    near = make_stack(n_views=20, size=8)
    far = far_field(near)
    results = [reconstruct(s, Options(accuracy="draft")) for s in (near, far)]
    assert [choice(r, "field") for r in results] == ["near", "far"]


def test_the_far_field_forced_on_a_near_rig_bends_the_normals():
    stack = make_stack(n_views=20, size=12, pitch=2.0)
    error = [
        angular_error_deg(reconstruct(stack, Options(field=field)).normals, stack.truth.normals).mean()
        for field in ("auto", "far")
    ]
    assert error[1] > 3.0 * error[0]
