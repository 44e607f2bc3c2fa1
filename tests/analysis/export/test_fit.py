"""The fit of the portable surface model."""

from __future__ import annotations

import numpy as np
import pytest

from analysis.export.fit import comparison_samples, fit_surfaces
from analysis.export.microfacet import MAX_DIELECTRIC_F0, Surfaces, evaluate
from analysis.reflectance.models import Cosines
from tests.analysis.export.gltf_shading import Surface, gltf_brdf
from tests.analysis.export.scene import GOLD, MATERIALS, VARNISH


def curves_of(*surfaces: Surface) -> np.ndarray:
    q = comparison_samples().cosines
    return np.stack([gltf_brdf(s, q.n_dot_h, q.cos_d, q.n_dot_l, q.n_dot_v) for s in surfaces])


def fitted(*surfaces: Surface) -> tuple[Surfaces, np.ndarray]:
    curves = curves_of(*surfaces)
    return fit_surfaces(lambda index: curves[index], len(curves))


def test_our_formulas_are_those_of_gltf():
    rng = np.random.default_rng(3)
    cosines = Cosines(*rng.uniform(0.05, 1.0, (4, 1, 50)))
    n = 20
    color, f0, roughness, metallic = rng.random((n, 3)), 0.08 * rng.random(n), rng.uniform(0.1, 1, n), rng.random(n)
    coat, coat_roughness = rng.random(n), rng.uniform(0.1, 1.0, n)
    ours = evaluate(Surfaces(color, metallic, f0, roughness, coat, coat_roughness), cosines)
    theirs = Surface(color[:, None], *(a[:, None] for a in (f0, roughness, metallic, coat, coat_roughness)))
    np.testing.assert_allclose(
        ours, gltf_brdf(theirs, cosines.n_dot_h, cosines.cos_d, cosines.n_dot_l, cosines.n_dot_v), rtol=1e-9
    )


def test_a_surface_of_the_model_comes_back():
    found, error = fitted(*MATERIALS[:4])
    assert error.max() < 0.005
    for k, true in enumerate(MATERIALS[:4]):
        np.testing.assert_allclose(found.base_color[k], true.color, atol=0.003)
        assert found.roughness[k] == pytest.approx(true.roughness, abs=0.005)
        assert found.metallic[k] == true.metallic
        if k != GOLD:
            assert found.f0[k] == pytest.approx(true.f0, abs=1e-3)


def test_two_lobes_get_a_coat_and_one_does_not():
    found, error = fitted(*MATERIALS)
    assert error[VARNISH] < 0.06
    assert found.clearcoat[VARNISH] > 0.7
    assert found.clearcoat_roughness[VARNISH] == pytest.approx(0.15, abs=0.03)
    assert not found.clearcoat[:VARNISH].any()


def test_a_matte_surface_is_no_rough_metal():
    found, error = fitted(Surface((0.7, 0.2, 0.1), f0=0.0, roughness=1.0))
    assert found.metallic[0] == 0.0
    assert error[0] < 1e-3


def test_a_pixel_half_of_metal_is_metallic_in_part():
    half = 0.5 * (curves_of(MATERIALS[0]) + curves_of(MATERIALS[GOLD]))
    found, error = fit_surfaces(lambda index: half[index], 1)
    assert 0.25 <= found.metallic[0] <= 0.75
    assert error[0] < 0.12


@pytest.mark.parametrize("level", [1e-4, 1.0, 30.0])
def test_parameters_stay_within_their_bounds(level: float):
    rng = np.random.default_rng(5)
    curves = level * curves_of(*MATERIALS) * rng.uniform(0.3, 2.0, (5, 1, 3))
    found, error = fit_surfaces(lambda index: curves[index], 5)
    assert np.isfinite(error).all()
    for name in ("base_color", "metallic", "roughness", "clearcoat", "clearcoat_roughness"):
        values = getattr(found, name)
        assert values.min() >= 0.0
        assert values.max() <= 1.0
    assert found.f0.max() <= MAX_DIELECTRIC_F0


def test_black_and_nothing_are_fitted_without_a_warning():
    found, error = fit_surfaces(lambda index: np.zeros((len(index), len(comparison_samples().weight), 3)), 2)
    assert found.base_color.max() < 1e-6
    assert np.isfinite(error).all()
    assert len(fit_surfaces(lambda index: np.zeros((0, 1, 3)), 0)[1]) == 0


def test_beyond_the_half_angles_seen_the_last_one_stands():
    samples = comparison_samples()
    stands = samples.within(np.deg2rad([30.0, 180.0, 0.0]))
    assert np.rad2deg(samples.theta_h[stands[0]]).max() == pytest.approx(30.0)
    np.testing.assert_array_equal(stands[1], np.arange(len(samples.theta_h)))
    np.testing.assert_array_equal(samples.azimuth[stands], np.broadcast_to(samples.azimuth, stands.shape))
    assert (samples.theta_h[stands[2]] == 0.0).all()
