"""The reference to compare with: one pixel by candidate normals and plain NNLS, in the manner of [hui2017].

For each candidate normal the samples of every channel are fitted by non-negative least squares with all
curves of a dictionary of materials, the pixel's own left out; the normal of least residual is the answer.
Candidates come from coarse to fine: a hexagonal grid over a cap, judged on the mean of the channels; then
the best few and their six neighbours, at half the spacing each time, judged on all channels.

Three times the candidates change the mean error by 2 % at most, and samples that are not weighed by their
noise raise it by a quarter (48 pixels a table, 65 views, 2 % noise): it is the dictionary that limits it.

Plain Python and `scipy.optimize.nnls` on one processor, cold at every candidate: slow by nature, and what the
speed of the other methods is stated against.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from analysis.reflectance.dictionary import Dictionary
from analysis.reflectance.models import Cosines
from analysis.reflectance.palette import NODES
from analysis.registration.stack import Stack

Array = NDArray[np.float64]

CAP_DEG = 48.0
"""Half width of the cap that the first candidates cover."""

FIRST_SPACING_DEG = 12.0

KEPT = (5, 3, 2, 2, 2, 1, 1)
"""Candidates that go on at each halving of the spacing; with the first grid about 375 problems a pixel."""

FINEST_SPACING_DEG = FIRST_SPACING_DEG / 2 ** len(KEPT)
"""0.094 deg: the answer is within about half of it of the best normal of all."""


@dataclass(frozen=True)
class ReferenceFit:
    """What was found for one pixel.

    Attributes
    ----------
    normal : ndarray, shape (3,)
    coefficient : ndarray, shape (C, K)
        Of the atoms, 1/sr as these.
    n_problems : int
        Non-negative least-squares problems that were solved.
    """

    normal: Array
    coefficient: Array
    n_problems: int


@dataclass(frozen=True)
class PixelSamples:
    """One pixel's samples, freed of light power and fall-off.

    Attributes
    ----------
    omega_i, h : ndarray, shape (N, 3)
    y, weight : ndarray, shape (N, C)
        Radiance times d^2 / P, and one over its sigma.
    """

    omega_i: Array
    h: Array
    y: Array
    weight: Array

    @property
    def mean(self) -> PixelSamples:
        """The mean over the channels as the only one."""
        sigma2 = np.mean(self.weight**-2.0, axis=1) / self.y.shape[1]
        return PixelSamples(self.omega_i, self.h, self.y.mean(axis=1)[:, None], sigma2[:, None] ** -0.5)


def pixel_samples(stack: Stack, pixel: int) -> PixelSamples:
    """Return the samples of the pixel of this flat index; the plane z = 0 is where it lies."""
    assert stack.variance is not None
    point = stack.grid.points().reshape(-1, 3)[pixel]
    to_light, to_camera = stack.light_position - point, stack.camera_position - point
    d2 = np.sum(to_light**2, axis=1)
    omega_i = to_light / np.sqrt(d2)[:, None]
    h = omega_i + to_camera / np.linalg.norm(to_camera, axis=1, keepdims=True)
    gain = (d2 / stack.light_power)[:, None]
    n, *_, n_channels = stack.radiance.shape
    radiance = stack.radiance.reshape(n, -1, n_channels)[:, pixel].astype(np.float64)
    sigma = np.sqrt(stack.variance.reshape(n, -1, n_channels)[:, pixel].astype(np.float64))
    return PixelSamples(omega_i, h / np.linalg.norm(h, axis=1, keepdims=True), radiance * gain, 1.0 / (sigma * gain))


def atom_table(dictionary: Dictionary) -> Array:
    """Tabulate a dictionary on the slice over `analysis.reflectance.palette.NODES`, shape (n_nodes, K), 1/sr."""
    return dictionary.evaluate(Cosines.on_slice(np.arccos(1.0 - NODES**2)))


def solve_pixel(samples: PixelSamples, table: Array) -> ReferenceFit:
    """Search the normal of one pixel.

    Parameters
    ----------
    samples : PixelSamples
    table : ndarray, shape (n_nodes, K)
        `atom_table`, without the columns that the pixel must not see.
    """
    rough = samples.mean
    grid = first_candidates()
    cost = np.array([_cost(rough, normal, table) for normal in grid])
    best = grid[np.argsort(cost)[: KEPT[0]]]
    costs = np.array([_cost(samples, normal, table) for normal in best])
    n_problems = len(grid) + 3 * len(best)
    spacing = np.deg2rad(FIRST_SPACING_DEG)
    for n_kept in KEPT:
        spacing *= 0.5
        order = np.argsort(costs)[:n_kept]
        kept = best[order]
        new = np.concatenate([neighbours(normal, spacing) for normal in kept])
        new_costs = [_cost(samples, normal, table) for normal in new]
        n_problems += samples.y.shape[1] * len(new)
        best, costs = np.concatenate([kept, new]), np.concatenate([costs[order], new_costs])
    normal = best[np.argmin(costs)]
    return ReferenceFit(normal, _fit(samples, normal, table)[0], n_problems)


def first_candidates() -> Array:
    """Return a hexagonal grid of normals `FIRST_SPACING_DEG` apart over the cap of `CAP_DEG`, shape (M, 3)."""
    n = int(CAP_DEG / FIRST_SPACING_DEG) + 1
    i, j = np.meshgrid(np.arange(-2 * n, 2 * n + 1), np.arange(-2 * n, 2 * n + 1))
    x, y = FIRST_SPACING_DEG * (i + 0.5 * j).ravel(), FIRST_SPACING_DEG * np.sqrt(0.75) * j.ravel()
    theta, azimuth = np.hypot(x, y), np.arctan2(y, x)
    inside = theta <= CAP_DEG + 1e-9
    theta, azimuth = np.deg2rad(theta[inside]), azimuth[inside]
    return np.stack([np.sin(theta) * np.cos(azimuth), np.sin(theta) * np.sin(azimuth), np.cos(theta)], axis=1)


def neighbours(normal: Array, spacing: float) -> Array:
    """Return the six normals `spacing` (rad) from one, shape (6, 3)."""
    side = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
    side /= np.linalg.norm(side)
    up = np.cross(normal, side)
    angle = np.arange(6)[:, None] * np.pi / 3
    return np.asarray(np.cos(spacing) * normal + np.sin(spacing) * (np.cos(angle) * side + np.sin(angle) * up))


def _cost(samples: PixelSamples, normal: Array, table: Array) -> float:
    return _fit(samples, normal, table)[1]


def _fit(samples: PixelSamples, normal: Array, table: Array) -> tuple[Array, float]:
    """Coefficients, shape (C, K), and chi-square with the normal held."""
    cosine = np.clip(samples.h @ normal, 0.0, 1.0)
    x = np.sqrt(1.0 - cosine) * (len(table) - 1)
    i = np.minimum(x.astype(np.int64), len(table) - 2)
    beyond = (x - i)[:, None]
    lit = np.maximum(samples.omega_i @ normal, 0.0)[:, None]
    columns = ((1.0 - beyond) * table[i] + beyond * table[i + 1]) * lit
    n_channels = samples.y.shape[1]
    coefficient, chi2 = np.zeros((n_channels, table.shape[1])), 0.0
    for c in range(n_channels):
        w = samples.weight[:, c]
        A = columns * w[:, None]
        scale = np.sqrt(np.einsum("ij,ij->j", A, A))
        scale = np.where(scale > 0.0, scale, 1.0)
        try:
            x, residual = nnls(A / scale, samples.y[:, c] * w)
        except RuntimeError:
            # It ran out of steps: this normal is no candidate.
            return coefficient, np.inf
        coefficient[c] = x / scale
        chi2 += residual**2
    return coefficient, chi2
