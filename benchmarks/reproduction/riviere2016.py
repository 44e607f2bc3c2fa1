"""Normals, albedo and roughness from backscatter by a free-form hand-held capture, after Riviere 2016 [riviere2016].

Written from public descriptions of the method, not from its code: the light counts as collocated with the
lens and the sample as flat, each pixel stands on its own. Diffuse albedo is the median over the views, diffuse
normals are Lambertian photometric stereo on the samples that the median calls diffuse, and what stands above is
one specular lobe: its first moment over the half vectors is a normal, its second the roughness.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.registration.stack import Stack

Array = NDArray[np.float64]

_N_ROUNDS = 6

_DIFFUSE_UP_TO = 1.05
"""A sample above the median by more than this factor counts as specular."""

_MIN_SAMPLES = 6

_SPECULAR_SHARE = 0.02
"""Of the diffuse albedo, below which there is no lobe to speak of."""


@dataclass(frozen=True)
class Backscatter:
    """What the pixels sent back to the lens.

    Attributes
    ----------
    values : ndarray, shape (N, P, C)
        Radiance freed of the light's power and fall-off: f cos, 1/sr; NaN = not seen.
    direction : ndarray, shape (N, P, 3)
        Towards the lens, sample frame, unit vectors.
    """

    values: Array
    direction: Array


@dataclass(frozen=True)
class Surface:
    """What comes of it for P pixels; NaN where too few samples were seen.

    Attributes
    ----------
    diffuse_normals, specular_normals : ndarray, shape (P, 3)
        The latter are NaN where there is no lobe.
    albedo, specular : ndarray, shape (P, C), (P,)
        Diffuse albedo; mean height of the lobe relative to it.
    roughness : ndarray, shape (P,)
        Root mean square tangent of the half angle over the lobe, per axis; NaN without one.
    """

    diffuse_normals: Array
    specular_normals: Array
    albedo: Array
    specular: Array
    roughness: Array

    @property
    def normals(self) -> Array:
        """Specular normals where there is a lobe, diffuse ones elsewhere."""
        return np.where(np.isfinite(self.specular_normals), self.specular_normals, self.diffuse_normals)


def backscatter_of(stack: Stack) -> Backscatter:
    """Return the samples of a stack with its light taken into the lens and its sample taken as flat."""
    points = stack.grid.points().reshape(-1, 3)
    away = stack.camera_position[:, None] - points
    distance = np.linalg.norm(away, axis=-1, keepdims=True)
    radiance = np.asarray(stack.radiance, np.float64).reshape(stack.n_views, len(points), -1)
    return Backscatter(radiance * distance**2 / stack.light_power[:, None, None], away / distance)


def recover(seen: Backscatter) -> Surface:
    """Recover P pixels.

    Parameters
    ----------
    seen : Backscatter

    References
    ----------
    [riviere2016]_, the free-form acquisition with the back camera.
    """
    grey, h = np.mean(seen.values, axis=-1), seen.direction
    diffuse = np.isfinite(grey)
    for _ in range(_N_ROUNDS):
        n = _lambertian(grey, h, diffuse)
        cosine = np.einsum("npi,pi->np", h, n)
        ratio = _per_cosine(grey, cosine)
        diffuse = ratio <= _DIFFUSE_UP_TO * _median(ratio)
    channels = np.moveaxis(seen.values, -1, 0)
    albedo = np.pi * np.stack([_median(_per_cosine(values, cosine)) for values in channels], axis=-1)
    specular_normals, share, roughness = _lobe(ratio, h, n)
    return Surface(n, specular_normals, albedo, share, roughness)


def _median(values: Array) -> Array:
    unseen = np.isnan(values).all(axis=0)
    return np.asarray(np.where(unseen, np.nan, np.nanmedian(np.where(unseen, 0.0, values), axis=0)))


def _per_cosine(values: Array, cosine: Array) -> Array:
    return np.asarray(np.where(cosine > 0.0, values / np.where(cosine > 0.0, cosine, 1.0), np.nan))


def _lambertian(values: Array, h: Array, used: NDArray[np.bool_]) -> Array:
    """Return the directions of the vectors b that fit b . h to the samples in use, shape (P, 3)."""
    weight = used.astype(np.float64)
    A = np.einsum("np,npi,npj->pij", weight, h, h)
    y = np.einsum("np,npi->pi", np.where(used, values, 0.0), h)
    solvable = (weight.sum(axis=0) >= _MIN_SAMPLES) & (np.linalg.cond(A) < 1e10)
    b = np.linalg.solve(np.where(solvable[:, None, None], A, np.eye(3)), y[..., None])[..., 0]
    length = np.linalg.norm(b, axis=-1)
    good = solvable & (length > 0.0)
    return np.asarray(np.where(good[:, None], b / np.where(good, length, 1.0)[:, None], np.nan))


def _lobe(ratio: Array, h: Array, normals: Array) -> tuple[Array, Array, Array]:
    """Return specular normals, relative height and roughness of what stands above the median."""
    median = _median(ratio)
    above = np.nan_to_num(np.maximum(ratio - _DIFFUSE_UP_TO * median, 0.0))
    share = np.mean(above, axis=0) / np.where(median > 0.0, median, np.nan)
    mean = np.einsum("np,npi->pi", above, h)
    length = np.linalg.norm(mean, axis=-1)
    lit = (share > _SPECULAR_SHARE) & (length > 0.0) & np.isfinite(normals[:, 0])
    n = np.where(lit[:, None], mean / np.where(lit, length, 1.0)[:, None], np.nan)
    cosine = np.clip(np.einsum("npi,pi->np", h, np.where(lit[:, None], n, 0.0)), 0.05, 1.0)
    total = np.where(lit, above.sum(axis=0), 1.0)
    variance = np.sum(above * (1.0 / cosine**2 - 1.0), axis=0) / total
    return n, np.asarray(share), np.asarray(np.where(lit, np.sqrt(0.5 * variance), np.nan))
