"""Normals as a smooth field: what its neighbours say of a pixel's slopes, as strongly as the scene bears out.

A pixel's slopes with its prior taken out again are its own word; a smoother of these words gives the next prior's mean.
How wide it is, whether it stays within a material, and how far the field is drawn towards the nearest one that is the
gradient of a surface, is what predicts best the words of pixels that it was not shown.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from analysis.depth.integration import integrate_slopes
from analysis.pixels.fits import PixelFits
from analysis.pixels.problem import NormalPrior

Array = NDArray[np.float64]

Labels = NDArray[np.int64]

WIDTHS_PX = (0.7, 1.0, 1.5, 2.2, 3.3, 5.0, 8.0)
"""Gaussian widths that are tried, pixels."""

GRADIENT_SHARES = (0.0, 0.5, 1.0)
"""How far towards a gradient field: an embossed card goes half-way, a relief all the way."""

_HELD_OUT = 0.15  # of the pixels

_TELLING = 20.0  # percentile of the words' precision; what is below tells nothing about a smoother

_STEEPEST = 1.0  # slope

_TINY = 1e-9

_FIRST_SPREAD, _SPREAD_ROUNDS = 0.03, 3  # of slopes about their neighbours'

_SPREADS, _INFLATIONS = np.geomspace(2e-4, 0.3, 40), np.geomspace(0.5, 30.0, 22)

# About a pixel, within which slopes are as rough as at it; and times the expected variance, up to which what is seen of
# it there is chance and a few pixels that stand out.
_ROUGH_PX, _NO_CHANCE = 2.0, 2.0

_NU = 4.0  # of Student's t: a few pixels stand in a wrong minimum

_STEEPEST_Z = 0.3  # of a normal: a slope beyond 73 deg is no word


@dataclass(frozen=True, slots=True)
class Words:
    """What pixels say of their own slopes.

    Attributes
    ----------
    slope : ndarray, shape (H, W, 2)
    precision : ndarray, shape (H, W)
        Of each slope.
    weight : ndarray, shape (H, W)
        Of the pixel in a mean with its neighbours.
    """

    slope: Array
    precision: Array
    weight: Array


@dataclass(frozen=True, slots=True)
class Smoother:
    """How a field is smoothed.

    Attributes
    ----------
    width : float
        Pixels.
    twice : bool
        What the first pass took off is smoothed and given back [tukey1977]: less blur at the same noise.
    within : bool
        Pixels learn of their own material's alone.
    gradient : float
        Share of the nearest gradient field in the mean.
    """

    width: float
    twice: bool
    within: bool
    gradient: float

    def mean(self, slope: Array, weight: Array, material: Labels) -> Array:
        """Return the smoothed field, shape (H, W, 2)."""
        smooth = self._smooth(slope, weight, material)
        if self.twice:
            smooth = smooth + self._smooth(slope - smooth, weight, material)
        if self.gradient > 0.0:
            smooth = (1.0 - self.gradient) * smooth + self.gradient * nearest_gradient(smooth)
        return smooth

    def mean_of_others(self, slope: Array, weight: Array, material: Labels) -> Array:
        """Return the smoothed field with each pixel's own part taken out, shape (H, W, 2).

        Of a linear smoother m = A x, the mean of the others is (m_i - A_ii x_i) / (1 - A_ii). Twice over, A_ii is about
        one and a half times that of once, since a Gaussian with itself has half its height.
        """
        total = self._total(weight, material)
        own = np.minimum((1.5 if self.twice else 1.0) * _centre(self.width) * weight / total, 0.95)[..., None]
        return np.asarray((self.mean(slope, weight, material) - own * slope) / (1.0 - own))

    def variance_of_others(self, weight: Array, material: Labels) -> Array:
        """Return the variance of the mean of the others, shape (H, W), where `weight` is the words' 1 / variance.

        Of equal weights it is sum_j A_ij^2 without the pixel's own, over (1 - A_ii)^2; a Gaussian has
        sum_j A_ij^2 = 1 / (4 pi width^2), 11/6 times that twice over.
        """
        once = _centre(self.width)
        own, square = (1.5 * once, 11.0 / 12.0 * once) if self.twice else (once, 0.5 * once)
        share = max(square - own**2, 0.05 * square) / (1.0 - min(own, 0.95)) ** 2
        return np.asarray(share / self._total(weight, material))

    def _total(self, weight: Array, material: Labels) -> Array:
        """Return the mean weight about each pixel, of its own material where only that counts."""
        if not self.within:
            return np.asarray(gaussian_filter(weight, self.width, mode="nearest") + _TINY)
        total = np.empty_like(weight)
        for k in np.unique(material):
            own = material == k
            total[own] = gaussian_filter(weight * own, self.width, mode="nearest")[own] + _TINY
        return total

    def _smooth(self, slope: Array, weight: Array, material: Labels) -> Array:
        if not self.within:
            return _mean(slope, weight, self.width)
        out = np.empty_like(slope)
        for k in np.unique(material):
            own = material == k
            out[own] = _mean(slope, weight * own, self.width)[own]
        return out


def _centre(width: float) -> float:
    """Return the weight of a pixel in its own Gaussian mean."""
    spike = np.zeros((33, 33))
    spike[16, 16] = 1.0
    return float(gaussian_filter(spike, width, mode="nearest")[16, 16])


def _mean(slope: Array, weight: Array, width: float) -> Array:
    total = gaussian_filter(weight, width, mode="nearest") + _TINY
    parts = [gaussian_filter(weight * slope[..., i], width, mode="nearest") / total for i in range(2)]
    return np.stack(parts, axis=-1)


def nearest_gradient(slope: Array) -> Array:
    """Return the field nearest to `slope`, shape (H, W, 2), that is the gradient of a surface; y points up."""
    valid = np.ones(slope.shape[:2], np.bool_)
    z = integrate_slopes(np.ascontiguousarray(slope[..., 0]), np.ascontiguousarray(slope[..., 1]), valid, 1.0)
    return np.stack([np.gradient(z, axis=1), -np.gradient(z, axis=0)], axis=-1)


def words(slope: Array, variance: Array, prior: Array, precision: Array, spread: Array) -> Words:
    """Take the prior out of the slopes.

    Parameters
    ----------
    slope, prior : ndarray, shape (H, W, 2)
        Most likely slopes, and their prior's mean.
    variance, precision : ndarray, shape (H, W)
        Of a slope given all, and of its prior.
    spread : ndarray, shape (H, W)
        How far slopes of the pixel's material are from their mean, one sigma.
    """
    own = np.maximum(1.0 / np.maximum(variance, 1e-8) - precision, 1e-3)
    slope = prior + (slope - prior) * ((own + precision) / own)[..., None]
    slope = np.clip(slope, -_STEEPEST, _STEEPEST)
    weight = 1.0 / (1.0 / own + spread**2)
    off = ((slope - prior) ** 2).sum(axis=-1) * weight / 2.0
    return Words(slope, own, weight / (1.0 + off / 4.0))


def choose_smoother(
    said: Words, material: Labels, rng: np.random.Generator, around: Smoother | None = None
) -> Smoother:
    """Return the smoother that predicts held-out words best; their own scatter counts as noise.

    Parameters
    ----------
    said : Words
    material : ndarray of int, shape (H, W)
    rng : numpy.random.Generator
        Draws what is held out.
    around : Smoother or None
        Only those next to it are tried; None = all.
    """
    hidden = rng.random(material.shape) < _HELD_OUT
    weight = np.where(hidden, _TINY * said.weight, said.weight)
    told = said.precision > 0.0  # a hole has no word
    judged = hidden & told & (said.precision >= np.percentile(said.precision[told], _TELLING))

    def score(smoother: Smoother) -> float:
        off = said.slope - smoother.mean(said.slope, weight, material)
        return float(np.mean(np.log(1e-6 + (off[judged] ** 2).sum(axis=-1) + 1.0 / said.precision[judged])))

    widths = [w for w in WIDTHS_PX if around is None or around.width / 1.6 < w < around.width * 1.6]
    plain = [Smoother(*how, 0.0) for how in product(widths, (False, True), (False, True))]
    best = min(plain, key=score)
    drawn = [Smoother(best.width, best.twice, best.within, share) for share in GRADIENT_SHARES]
    return min(drawn, key=score)


@dataclass(frozen=True, slots=True)
class Told:
    """What pixels' neighbours say of their normals.

    Attributes
    ----------
    prior : NormalPrior
        In the units of a solver whose stated variance of a normal is `inflation` times too small.
    inflation : float
        How much larger the variance of the normals is than was stated, by how they differ from their neighbours.
    smoother : Smoother
    spread : float
        Of a pixel's slopes about its neighbours' mean, one sigma.
    """

    prior: NormalPrior
    inflation: float
    smoother: Smoother
    spread: float


def ask_neighbours(fits: PixelFits, shape: tuple[int, int], material: Labels, rng: np.random.Generator) -> Told:
    """Find what the neighbours of each pixel say of its normal, the pixel itself left out.

    Parameters
    ----------
    fits : PixelFits
        Of the H * W pixels, each solved by itself; those that are not solved say nothing.
    shape : (int, int)
        H and W.
    material : ndarray of int, shape (H * W,)
    rng : numpy.random.Generator
    """
    solved = fits.normals[:, 2] > _STEEPEST_Z
    slope = np.where(solved[:, None], _slopes(fits.normals), 0.0).reshape(*shape, 2)
    variance = np.where(solved, 0.5 * (fits.covariance[:, 0] + fits.covariance[:, 2]), np.inf).reshape(shape)
    material, spread, inflation = material.reshape(shape), _FIRST_SPREAD, 1.0
    said = _weighed(slope, variance, spread, inflation)
    smoother = choose_smoother(said, material, rng)
    for _ in range(_SPREAD_ROUNDS):
        mean = smoother.mean_of_others(said.slope, said.weight, material)
        off2 = ((slope - mean) ** 2).sum(axis=-1)
        of_mean = smoother.variance_of_others(1.0 / variance, material)
        spread, inflation = _scatter(off2, variance + of_mean)
        said = _weighed(slope, variance, spread, inflation)
    # Fine detail beside a smooth ground is as rough as it is there, and at an edge a pixel is not like its neighbours.
    known = inflation * (variance + of_mean)
    beyond = _local_scatter(off2, np.isfinite(variance)) - _NO_CHANCE * (known + spread**2)
    rough = spread**2 + np.maximum(beyond, 0.0)
    alike = np.minimum((_NU + 2.0) / (_NU + off2 / (known + rough)), 1.0)
    alike, rough = (np.where(np.isfinite(variance), a, b).ravel() for a, b in ((alike, 1.0), (rough, spread**2)))
    normal = np.concatenate([-mean, np.ones((*shape, 1))], axis=-1).reshape(-1, 3)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    sigma = np.sqrt((rough / inflation + of_mean.ravel()) / alike)
    return Told(NormalPrior(normal, sigma), max(inflation, 1.0), smoother, spread)


def _weighed(slope: Array, variance: Array, spread: float, inflation: float) -> Words:
    precision = 1.0 / np.maximum(inflation * variance, 1e-12)
    return Words(slope, precision, 1.0 / (inflation * variance + spread**2))


def _local_scatter(off2: Array, told: NDArray[np.bool_]) -> Array:
    """Return the variance of a slope about its neighbours' mean, from what is seen of it around each pixel."""
    total = gaussian_filter(np.where(told, 0.5 * off2, 0.0), _ROUGH_PX, mode="nearest")
    return np.asarray(total / (gaussian_filter(told.astype(np.float64), _ROUGH_PX, mode="nearest") + _TINY))


def _scatter(off2: Array, variance: Array) -> tuple[float, float]:
    """Return spread and inflation at which what is left of the slopes is most likely.

    Of two components each with the variance T = inflation v + spread^2, Student's t of nu degrees of freedom:
    -log p = log T + (nu + 2) / 2 log(1 + r^2 / (nu T)).
    """
    told = np.isfinite(variance)
    step = max(int(told.sum()) // 20000, 1)
    r2, v = off2[told][::step], variance[told][::step]

    def cost(spread: float, inflation: float) -> float:
        T = inflation * v + spread**2
        return float(np.mean(np.log(T) + 0.5 * (_NU + 2.0) * np.log1p(r2 / (_NU * T))))

    return min(product(_SPREADS.tolist(), _INFLATIONS.tolist()), key=lambda pair: cost(*pair))


def _slopes(normals: Array) -> Array:
    return np.asarray(-normals[:, :2] / np.maximum(normals[:, 2:], 0.1))
