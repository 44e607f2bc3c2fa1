"""The model of one pixel: its derivatives, and what single precision costs it."""

import numpy as np
import pytest

from analysis.pixels.model import allocate_fit, evaluate, normal_equations
from analysis.pixels.nnls import MAX_ATOMS, nnls, nnls_work
from analysis.pixels.problem import Noise, PixelProblem, Settings
from analysis.pixels.samples import NEAR_PLANAR, allocate_pixel, load, plain_weights
from analysis.reflectance.dictionary import SliceTable, parametric
from analysis.reflectance.models import Cosines
from analysis.reflectance.palette import NODES, Palette
from analysis.registration.stack import Stack
from benchmarks.accuracy.settings import fine_dictionary
from tests.synthetic import brdf

STEP = 2e-4  # rad; a few nodes of the tables, whose interpolation has kinks


def true_palette() -> Palette:
    """Return the curves of the synthetic sample's three materials."""
    theta = np.arccos(1.0 - NODES**2)
    d = np.stack([np.sin(theta), np.zeros_like(theta), np.cos(theta)], axis=-1)
    up = np.array([0.0, 0.0, 1.0])
    return Palette(np.stack([brdf(up, d, d, np.full(len(theta), k)).T for k in range(3)]))


class OnePixel:
    """One pixel's fit at any normal, with the weights and the atoms of the first."""

    def __init__(self, stack: Stack, shared: bool, pixel: int) -> None:
        self.settings = Settings(1e-3, 0.0, 2.0, 3 if shared else MAX_ATOMS, robust=True, shared=shared, cold=False)
        if shared:
            self.table, self.derivative = true_palette().tables()
        else:
            atoms = parametric().slice_table()
            self.table, self.derivative = atoms.value[None], atoms.derivative[None]
        problem = PixelProblem(stack, parametric(), np.array([pixel]), stack.truth.depth)
        n_views, _, n_channels = problem.samples.radiance.shape
        self.px = allocate_pixel(n_views, n_channels)
        load(problem.samples, problem.geometry(), self.settings, 0, self.px)
        plain_weights(self.px, self.settings)
        self.fit = allocate_fit(n_views, n_channels, self.settings, self.table)
        self.work = nnls_work(self.fit.target.shape[1], self.table.shape[2])

    def cost(self, normal: np.ndarray, *, moved: float = 0.0) -> float:
        """Half the weighted sum of squares with the coefficients fitted, and half the prior's."""
        n = normal / np.linalg.norm(normal)
        evaluate(self.px, self.fit, self.settings, self.table, self.work, n, np.inf, moved)
        return 0.5 * float(np.sum(self.fit.pull * self.fit.r**2)) + (1.0 - n[2]) / NEAR_PLANAR**2


@pytest.mark.parametrize("pixel", [30, 280, 330, 560])
@pytest.mark.parametrize("shared", [False, True])
def test_the_gradient_is_the_slope_of_the_cost_with_the_coefficients_refitted(stack: Stack, shared: bool, pixel: int):
    one = OnePixel(stack, shared, pixel)
    truth = stack.truth.normals.reshape(-1, 3)[pixel]
    normal = truth + np.array([0.02, -0.01, 0.0])
    normal /= np.linalg.norm(normal)
    t1 = np.cross(normal, [0.0, 1.0, 0.0])
    t1 /= np.linalg.norm(t1)
    t2 = np.cross(normal, t1)
    one.cost(normal, moved=np.inf)
    H, gradient = np.empty((2, 2)), np.empty(2)
    one.cost(normal)
    normal_equations(one.px, one.fit, one.settings, one.derivative, t1, t2, H, gradient)
    slope = [(one.cost(normal + STEP * t) - one.cost(normal - STEP * t)) / (2.0 * STEP) for t in (t1, t2)]
    np.testing.assert_allclose(-gradient, slope, atol=0.02 * np.abs(slope).max())


@pytest.mark.parametrize("seed", range(6))
def test_single_precision_costs_nothing_though_the_dictionary_is_near_copies_of_itself(seed: int):
    """346 atoms, any of which others make to a millionth: the fit is that of double precision on the atoms chosen."""
    rng = np.random.default_rng(seed)
    theta = np.sort(rng.uniform(0.02, 1.3, 65))
    dictionary = fine_dictionary(56, 6)
    phi = dictionary.evaluate(Cosines.on_slice(theta)) / SliceTable.from_dictionary(dictionary).scale
    phi *= np.cos(theta)[:, None]
    singular = np.linalg.svd(phi, compute_uv=False)
    assert singular[0] / singular[-1] > 1e7
    y = phi[:, rng.choice(phi.shape[1], 3, replace=False)] @ rng.uniform(0.2, 1.0, 3)
    y *= 1.0 + 0.005 * rng.standard_normal(len(y))
    w = 1.0 / (0.005 * y) ** 2
    active, a = np.zeros(MAX_ATOMS, np.int64), np.zeros(MAX_ATOMS)
    m = nnls(phi.astype(np.float32), w, y, 2.0, MAX_ATOMS, 0, active, a, nnls_work(*phi.shape))
    root = np.sqrt(w)
    chosen = phi[:, active[:m]]
    exact = np.linalg.lstsq(chosen * root[:, None], y * root, rcond=None)[0]
    np.testing.assert_allclose(chosen @ a[:m], chosen @ exact, rtol=1e-4)


def test_what_is_fitted_reflects_no_more_than_it_receives(fits, stack: Stack):
    """The albedo of a patch seen from above, its fitted BRDF integrated over where the light may stand."""
    some = np.arange(0, 576, 25)
    part = fits.select(some)
    theta, phi = np.meshgrid((np.arange(60) + 0.5) / 60 * np.pi / 2, (np.arange(24) + 0.5) / 24 * 2.0 * np.pi)
    light = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1).reshape(-1, 3)
    solid = (np.sin(theta) * np.cos(theta)).ravel() * (np.pi / 2 / 60) * (2.0 * np.pi / 24)
    up = np.array([0.0, 0.0, 1.0])
    one = Cosines.from_directions(up, light, up)
    q = Cosines(
        *(np.broadcast_to(c, (len(some), len(light))) for c in (one.n_dot_h, one.cos_d, one.n_dot_l, one.n_dot_v))
    )
    albedo = np.einsum("plc,l->pc", part.brdf(q), solid)
    truth = np.einsum("plc,l->pc", brdf(up, light, up, stack.truth.material.ravel()[some][:, None]), solid)
    assert albedo.max() < 1.0
    np.testing.assert_allclose(albedo, truth, rtol=0.1)


def test_a_diffuse_patch_has_the_albedo_that_it_was_given():
    """Radiance of a patch of albedo 0.99 that reflects evenly, in the stack's units."""
    camera = np.random.default_rng(0).normal(0.0, 150.0, (30, 3))
    camera[:, 2] = 300.0 + np.abs(camera[:, 2])
    d2 = np.sum(camera**2, axis=1)
    radiance = (0.99 / np.pi * camera[:, 2] / np.sqrt(d2) / d2).astype(np.float32)
    stack = Stack(radiance[:, None, None, None], camera, camera, 0.1, np.ones(30))
    fit = PixelProblem(stack, parametric()).solve(Noise(1e-3, 0.0))
    f = fit.brdf(Cosines.on_slice(np.array([[0.3]])))[0, 0, 0]
    assert f == pytest.approx(0.99 / np.pi, rel=0.01)
