import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from analysis.few_views.field import Smoother, Words, ask_neighbours, choose_smoother, nearest_gradient
from analysis.pixels.fits import PixelFits
from analysis.reflectance.dictionary import lambertian

SHAPE = (80, 90)


def gradient_field(rng: np.random.Generator, width: float) -> np.ndarray:
    z = gaussian_filter(rng.standard_normal(SHAPE), width, mode="wrap")
    slope = np.stack([np.gradient(z, axis=1), -np.gradient(z, axis=0)], axis=-1)
    return 0.1 * slope / slope.std()


def words_of(slope: np.ndarray, sigma: float) -> Words:
    precision = np.full(SHAPE, sigma**-2.0)
    return Words(slope, precision, precision)


def fits_with(slope: np.ndarray, stated: float) -> PixelFits:
    n = np.concatenate([-slope, np.ones((*slope.shape[:2], 1))], axis=-1).reshape(-1, 3)
    P = len(n)
    return PixelFits(
        normals=n / np.linalg.norm(n, axis=1, keepdims=True),
        covariance=stated**2 * np.tile([1.0, 0.0, 1.0], (P, 1)),
        reduced_chi2=np.ones(P),
        loss=np.ones(P),
        atom=np.zeros((P, 1, 6), np.int16),
        coefficient=np.ones((P, 1, 6)),
        flags=np.zeros(P, np.uint8),
        theta_h_range=np.zeros((P, 2)),
        dictionary=lambertian(),
    )


NONE = np.zeros(SHAPE, np.int64)


def test_noisy_words_of_a_smooth_field_are_smoothed_widely_and_exact_ones_hardly():
    rng = np.random.default_rng(0)
    smooth = gradient_field(rng, 8.0)
    noisy = smooth + 0.05 * rng.standard_normal(smooth.shape)
    wide = choose_smoother(words_of(noisy, 0.05), NONE, rng)
    narrow = choose_smoother(words_of(gradient_field(rng, 1.5), 0.001), NONE, rng)
    assert wide.width >= 2.2
    assert narrow.width <= 1.0
    better = wide.mean(noisy, np.ones(SHAPE), NONE)
    assert np.abs(better - smooth).mean() < 0.3 * np.abs(noisy - smooth).mean()


def test_materials_whose_slopes_differ_are_smoothed_apart():
    rng = np.random.default_rng(1)
    material = (np.arange(SHAPE[1]) // 10 % 2)[None].repeat(SHAPE[0], axis=0)
    slope = np.where(material[..., None] == 1, 0.2, -0.2) + 0.05 * rng.standard_normal((*SHAPE, 2))
    assert choose_smoother(words_of(slope, 0.05), material, rng).within


def test_the_gradient_of_a_surface_is_its_own_nearest_gradient():
    slope = gradient_field(np.random.default_rng(2), 6.0)
    inner = (slice(4, -4), slice(4, -4))
    np.testing.assert_allclose(nearest_gradient(slope)[inner], slope[inner], atol=0.03)


@pytest.mark.parametrize("twice", [False, True])
def test_the_mean_of_the_others_has_nothing_of_the_pixel_itself(twice: bool):
    rng = np.random.default_rng(3)
    smoother = Smoother(1.5, twice, within=False, gradient=0.0)
    weight = np.ones(SHAPE)
    noise = rng.standard_normal((*SHAPE, 2))
    others = smoother.mean_of_others(noise, weight, NONE)
    inner = (slice(8, -8), slice(8, -8))
    own = np.mean(others[inner] * noise[inner])
    assert abs(own) < 0.02
    stated = smoother.variance_of_others(weight, NONE)[inner].mean()
    assert others[inner].var() == pytest.approx(stated, rel=0.15)


def test_neighbours_tell_how_far_a_stated_sigma_holds():
    """Normals twice as far from a smooth surface as was stated: neither trusted, nor taken for the surface."""
    rng = np.random.default_rng(4)
    smooth = gradient_field(rng, 9.0)
    slope = smooth + 0.02 * rng.standard_normal(smooth.shape)
    told = ask_neighbours(fits_with(slope, 0.01), SHAPE, NONE.ravel(), rng)
    assert 2.5 < told.inflation < 6.0
    off = -told.prior.normal[:, :2] / told.prior.normal[:, 2:] - smooth.reshape(-1, 2)
    z = off / (told.prior.sigma * np.sqrt(told.inflation))[:, None]
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.3


def test_at_an_edge_neighbours_are_believed_less():
    rng = np.random.default_rng(5)
    slope = np.where(np.arange(SHAPE[1]) < 45, -0.3, 0.3)[None, :, None].repeat(SHAPE[0], axis=0).repeat(2, axis=-1)
    slope = slope + 0.004 * rng.standard_normal(slope.shape)
    told = ask_neighbours(fits_with(slope, 0.004), SHAPE, NONE.ravel(), rng)
    sigma = told.prior.sigma.reshape(SHAPE)
    assert sigma[:, 44:46].mean() > 3.0 * sigma[:, 10:30].mean()


def test_pixels_that_are_not_solved_are_told_and_say_nothing():
    rng = np.random.default_rng(6)
    slope = gradient_field(rng, 9.0) + 0.02 * rng.standard_normal((*SHAPE, 2))
    fits = fits_with(slope, 0.02)
    fits.normals[1234] = np.nan
    fits.covariance[1234] = np.nan
    told = ask_neighbours(fits, SHAPE, NONE.ravel(), rng)
    assert np.isfinite(told.prior.normal).all()
    assert np.isfinite(told.prior.sigma).all()


def test_fine_detail_beside_a_smooth_ground_is_not_taken_for_as_smooth_as_it():
    """A coin: its relief is rougher by far than the ground, which most of its pixels see."""
    rng = np.random.default_rng(7)
    slope = gradient_field(rng, 9.0)
    fine = np.zeros(SHAPE, bool)
    fine[30:60, 30:60] = True
    slope[fine] = 0.3 * rng.standard_normal((int(fine.sum()), 2))
    told = ask_neighbours(fits_with(slope + 0.002 * rng.standard_normal(slope.shape), 0.002), SHAPE, NONE.ravel(), rng)
    sigma = told.prior.sigma.reshape(SHAPE)
    assert np.median(sigma[35:55, 35:55]) > 0.2
    assert np.median(sigma[:20]) < 0.05
    off = -told.prior.normal[:, :2] / told.prior.normal[:, 2:] - slope.reshape(-1, 2)
    z = off[fine.ravel()] / told.prior.sigma[fine.ravel(), None]
    assert np.sqrt(np.mean(z**2)) < 1.2
