import numpy as np
import pytest

from analysis.few_views import kernels
from analysis.few_views.kernels import Field, Materials, Seen


@pytest.fixture
def scene() -> tuple[Seen, Materials, Field]:
    rng = np.random.default_rng(1)
    V, P, C = 9, 4, 3

    def unit(*shape: int) -> np.ndarray:
        d = np.concatenate([0.4 * rng.standard_normal((*shape, 2)), np.ones((*shape, 1))], axis=-1)
        return (d / np.linalg.norm(d, axis=-1, keepdims=True)).astype(np.float32)

    light = unit(V, P)
    seen = Seen(
        np.zeros((V, P, C), np.float32), np.ones((V, P, C), np.uint8), np.zeros((V, P, C), np.uint8), light, light,
        np.zeros((V, P), np.float32),
    )  # fmt: skip
    t = np.linspace(0.0, 1.0, 512)
    table = np.stack([np.stack([np.log(0.2 + np.exp(-((t / 0.1) ** 2)) * (1 + c)) for c in range(C)])])
    materials = Materials(table, np.array([400.0]), np.linalg.inv(0.02 * np.ones((C, C)) + 0.01 * np.eye(C)), 1e-3)
    field = Field(
        np.zeros(P, np.int64), 0.1 * rng.standard_normal((P, 2)), 0.1 * rng.standard_normal((P, C)), np.zeros((P, 2)),
        np.full(P, 1.0), np.zeros(P), np.zeros((P, 3)), np.zeros(P),
    )  # fmt: skip
    return seen, materials, field


def test_slopes_and_albedos_are_found_again(scene: tuple[Seen, Materials, Field]):
    seen, materials, field = scene
    pixels = np.arange(4)
    out = np.empty((9, 4, 3))
    kernels.predict(pixels, seen, materials, field, out)
    seen = seen._replace(radiance=out.astype(np.float32))
    begun = kernels.copied(field)
    begun.slope[:] = 0.0
    begun.albedo[:] = 0.0
    kernels.fit_pixels(pixels, seen, materials, begun, 40)
    np.testing.assert_allclose(begun.slope, field.slope, atol=2e-3)
    np.testing.assert_allclose(begun.albedo, field.albedo, atol=2e-2)


def test_the_covariance_is_the_scatter_of_the_slopes(scene: tuple[Seen, Materials, Field]):
    """Gaussian errors of the stated size, independent: slopes scatter as far as is said."""
    seen, materials, field = scene
    pixels = np.arange(4)
    out = np.empty((9, 4, 3))
    kernels.predict(pixels, seen, materials, field, out)
    rng, found = np.random.default_rng(2), []
    for _ in range(300):
        noisy = seen._replace(radiance=(out * np.exp(0.05 * rng.standard_normal(out.shape))).astype(np.float32))
        begun = kernels.copied(field)
        kernels.fit_pixels(pixels, noisy, materials, begun, 20)
        found.append(begun.slope.copy())
    scatter = np.stack(found).var(axis=0)
    stated = begun.covariance[:, [0, 2]]
    assert np.all(stated > 0.6 * scatter)
    assert np.all(stated < 2.0 * scatter)


def test_a_clipped_sample_is_a_bound_that_pulls_gently(scene: tuple[Seen, Materials, Field]):
    seen, materials, field = scene
    pixels, out = np.arange(4), np.empty((9, 4, 3))
    kernels.predict(pixels, seen, materials, field, out)
    brightest = out.sum(axis=2).argmax(axis=0)
    losses = []
    for factor, clipped in ((0.5, 0), (0.5, 1), (1.0, 1)):
        radiance, mask = out.copy(), seen.clipped.copy()
        for x in pixels:
            radiance[brightest[x], x] *= factor
            mask[brightest[x], x] = clipped
        begun = kernels.copied(field)
        kernels.fit_pixels(
            pixels, seen._replace(radiance=radiance.astype(np.float32), clipped=mask), materials, begun, 0
        )
        losses.append(begun.loss)
    value, bound, kept = losses
    assert np.all(value > bound)
    assert np.all(bound > kept)
