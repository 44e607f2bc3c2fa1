"""The backscatter method: exact where its assumptions hold, and scored on what it is said to get wrong."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from analysis.evaluation.metrics import angular_error_deg
from benchmarks.reproduction.experiments.riviere import Estimate, errors
from benchmarks.reproduction.riviere2016 import Backscatter, recover

Array = NDArray[np.float64]

N_VIEWS, RADIUS = 65, 0.6


def _directions(n_pixels: int) -> Array:
    """Return directions to the lens in a cone about z, shape (N, P, 3)."""
    rng = np.random.default_rng(2)
    slope = rng.normal(0.0, 0.35, (N_VIEWS, 2))
    h = np.column_stack([slope, np.ones(N_VIEWS)])
    h /= np.linalg.norm(h, axis=1, keepdims=True)
    return np.broadcast_to(h[:, None], (N_VIEWS, n_pixels, 3)).copy()


def _sphere() -> Array:
    """Return the normals of the part of a sphere that all views see, shape (P, 3)."""
    x, y = (a.ravel() for a in np.meshgrid(*[np.linspace(-RADIUS, RADIUS, 9) * 0.5] * 2))
    return np.stack([x, y, np.sqrt(1.0 - x**2 - y**2)], axis=1)


def _seen(normals: Array, albedo: Array, lobe: float = 0.0, width: float = 0.1) -> Backscatter:
    h = _directions(len(normals))
    cosine = np.clip(np.einsum("npi,pi->np", h, normals), 0.0, 1.0)
    f = albedo / np.pi + lobe * np.exp(-(1.0 / np.maximum(cosine, 0.1) ** 2 - 1.0) / width**2)[..., None]
    return Backscatter(f * cosine[..., None], h)


def test_a_lambertian_sphere_is_recovered_exactly() -> None:
    normals, albedo = _sphere(), np.array([0.7, 0.4, 0.1])
    found = recover(_seen(normals, albedo))
    assert angular_error_deg(found.normals, normals).max() < 1e-6
    np.testing.assert_allclose(found.albedo, np.broadcast_to(albedo, found.albedo.shape), rtol=1e-9)
    assert np.isnan(found.roughness).all()


def test_a_highlight_is_kept_out_of_diffuse_normals_and_albedo() -> None:
    normals, albedo = _sphere(), np.array([0.4, 0.4, 0.4])
    found = recover(_seen(normals, albedo, lobe=1.0))
    assert angular_error_deg(found.diffuse_normals, normals).mean() < 0.5
    np.testing.assert_allclose(found.albedo, 0.4, rtol=0.02)


def test_a_rougher_lobe_is_found_rougher() -> None:
    normals, albedo = _sphere(), np.array([0.4, 0.4, 0.4])
    narrow, wide = (recover(_seen(normals, albedo, lobe=2.0, width=width)).roughness for width in (0.15, 0.25))
    both = np.isfinite(narrow) & np.isfinite(wide)
    assert both.mean() > 0.5
    assert np.all(narrow[both] < wide[both])


def test_a_pixel_that_hardly_any_view_shows_has_no_normal() -> None:
    seen = _seen(_sphere(), np.array([0.5, 0.5, 0.5]))
    seen.values[5:, 3] = np.nan
    found = recover(seen)
    assert np.isnan(found.normals[3]).all()
    assert np.isfinite(np.delete(found.normals, 3, axis=0)).all()


def _estimate(depth: Array, pitch: float) -> Estimate:
    q, p = np.gradient(depth, pitch)
    normals = np.stack([-p, q, np.ones_like(p)], axis=-1)
    return Estimate("", normals / np.linalg.norm(normals, axis=-1, keepdims=True), depth - depth.mean())


@pytest.mark.parametrize(("wavelength", "is_gross"), [(80.0, True), (2.0, False)])
def test_an_error_counts_as_gross_shape_or_as_detail_by_how_broad_it_is(wavelength: float, is_gross: bool) -> None:
    pitch, n = 0.25, 176
    x = (np.arange(n) - n / 2) * pitch
    truth = np.broadcast_to(0.2 * np.sin(x / 3.0), (n, n))
    off = truth + 0.1 * wavelength / 10.0 * np.sin(2.0 * np.pi * x / wavelength)[:, None]
    e = errors(_estimate(off, pitch), _estimate(truth, pitch), pitch)
    assert (e.gross_mm > 0.1) == is_gross
    assert (e.detail_deg > 1.0) != is_gross


def test_the_truth_has_no_error() -> None:
    truth = _estimate(np.random.default_rng(1).normal(size=(20, 20)), 0.5)
    e = errors(truth, truth, 0.5)
    assert (e.normals_deg, e.gross_mm, e.detail_deg) == (0.0, 0.0, 0.0)
