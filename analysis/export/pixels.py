"""The surface of every pixel: pixels of like mixture share one fit, those outside the palette have their own."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.export.fit import comparison_samples, fit_surfaces
from analysis.export.microfacet import MAX_DIELECTRIC_F0, Surfaces
from analysis.palette.materials import materials_used
from analysis.pixels.fits import PixelFits
from analysis.pixels.problem import tiles
from analysis.reflectance.models import Cosines
from analysis.reflectance.palette import PALETTE

Array = NDArray[np.float64]

SHARE_STEPS = 32
"""Steps of a material's share within one class of pixels."""

LEVEL_STEPS = 8
"""Steps of a class in a doubling of the level."""


@dataclass(frozen=True)
class PixelSurfaces:
    """Surfaces of P solved pixels.

    Attributes
    ----------
    surfaces : Surfaces
        Of every pixel.
    error : ndarray, shape (P,)
        Relative, of the fit that a pixel uses.
    in_palette : ndarray of bool, shape (P,)
    clipped : ndarray of bool, shape (P,)
        Some colour would be above 1.
    n_classes : int
        Fits that pixels of the palette share.
    """

    surfaces: Surfaces
    error: Array
    in_palette: NDArray[np.bool_]
    clipped: NDArray[np.bool_]
    n_classes: int


def pixel_surfaces(fits: PixelFits, scale: float) -> PixelSurfaces:
    """Fit the surface model to every pixel.

    Parameters
    ----------
    fits : PixelFits
        All solved.
    scale : float
        Reflectance in one unit of the fits' BRDF times pi.
    """
    in_palette, class_of, first = classes(fits)

    def curves(index: NDArray[np.int64]) -> Array:
        return _curves(fits.select(first[index]), scale, in_palette[first[index]])

    surfaces, error = fit_surfaces(curves, len(first))
    ratio = np.ones((len(class_of), 3))
    if in_palette.any():
        level = _brightness(fits)
        within = level / np.maximum(level[first][class_of], 1e-12 * level.max())
        ratio[in_palette] = within[in_palette]
    of_pixel, clipped = _levelled(surfaces.select(class_of), ratio)
    return PixelSurfaces(of_pixel, error[class_of], in_palette, clipped, len(np.unique(class_of[in_palette])))


def classes(fits: PixelFits) -> tuple[NDArray[np.bool_], NDArray[np.int64], NDArray[np.int64]]:
    """Group the pixels that mix the palette's materials alike; every other pixel is a class of its own.

    Returns
    -------
    in_palette : ndarray of bool, shape (P,)
        Made of the palette's materials alone.
    class_of : ndarray, shape (P,)
    first : ndarray, shape (number of classes,)
        The pixel that stands for each class.
    """
    n = len(fits.normals)
    material = materials_used(fits)
    coefficient = np.where(material >= 0, fits.coefficient[:, 0], 0.0)
    used = (fits.atom[:, 0] >= 0) & (fits.coefficient[:, 0] > 0.0)
    of_others = (used & (material < 0)).any(axis=1)
    in_palette = np.asarray(used.any(axis=1) & ~of_others & (fits.dictionary.name == PALETTE))
    shares = np.zeros((n, int(material.max(initial=-1)) + 2))
    np.add.at(shares, (np.arange(n)[:, None], material), coefficient)
    # The last column has taken what is of no material.
    shares = shares[:, :-1]
    level = shares.sum(axis=1, keepdims=True)
    steps = np.round(SHARE_STEPS * shares / np.where(level > 0.0, level, 1.0)).astype(np.int32)
    stops = np.round(LEVEL_STEPS * np.log2(np.maximum(level, 1e-12))).astype(np.int32)
    own = np.where(in_palette, 0, np.arange(1, n + 1))[:, None]
    key = np.where(in_palette[:, None], np.hstack([steps, stops]), 0)
    _, first, class_of = np.unique(np.hstack([key, own]), axis=0, return_index=True, return_inverse=True)
    return in_palette, class_of.reshape(-1).astype(np.int64), first.astype(np.int64)


def _atom_values(fits: PixelFits, cosines: Cosines) -> tuple[NDArray[np.int64], Array]:
    """Return the atoms in use and their values, shape (number of atoms, S)."""
    used = np.unique(fits.atom[fits.atom >= 0]).astype(np.int64)
    values = [fits.dictionary.atoms[k].evaluate(cosines) for k in used]
    return used, np.array(values).reshape(len(used), len(cosines.n_dot_h))


def _weights(fits: PixelFits, used: NDArray[np.int64]) -> Array:
    """Return how much of each atom in use every pixel has, shape (P, C, number of atoms)."""
    n, n_channels, n_slots = fits.atom.shape
    weights = np.zeros((n * n_channels, len(used) + 1))
    column = np.where(fits.atom >= 0, np.searchsorted(used, fits.atom), len(used)).reshape(-1, n_slots)
    np.add.at(weights, (np.arange(len(weights))[:, None], column), fits.coefficient.reshape(-1, n_slots))
    return weights[:, :-1].reshape(n, n_channels, len(used))


def _curves(fits: PixelFits, scale: float, in_palette: NDArray[np.bool_]) -> Array:
    """Return the BRDFs at the samples of comparison, shape (P, S, 3)."""
    samples = comparison_samples()
    used, values = _atom_values(fits, samples.cosines)
    curves = _weights(fits, used) @ values * scale
    # A palette's materials are completed; what a pixel of its own has beyond the half angles it was seen at is nobody's
    # knowledge and may be anything: there its last value stands.
    seen = np.where(in_palette, np.pi, fits.theta_h_range[:, 1])
    curves = np.take_along_axis(curves, samples.within(seen)[:, None], axis=2).transpose(0, 2, 1)
    return np.asarray(np.broadcast_to(curves, (*curves.shape[:2], 3)))


def _brightness(fits: PixelFits) -> Array:
    """Return the mean BRDF over the slice's half angles from 20 to 65 deg, away from most lobes, shape (P, 3)."""
    used, values = _atom_values(fits, Cosines.on_slice(np.deg2rad(np.linspace(20.0, 65.0, 10))))
    parts = [_weights(fits.select(tile), used) @ values.mean(axis=1) for tile in tiles(np.arange(len(fits.normals)))]
    mean = np.concatenate(parts)
    return np.asarray(np.broadcast_to(mean, (len(mean), 3)))


def _levelled(surfaces: Surfaces, ratio: Array) -> tuple[Surfaces, NDArray[np.bool_]]:
    """Make surfaces brighter by `ratio` (P, 3) as far as colours and F0 may go; tell where a colour was held back.

    A pixel differs from the one that stands for its class by the rest of its shares and its level.
    """
    wanted = surfaces.base_color * ratio
    f0 = np.minimum(surfaces.f0 * ratio.mean(axis=1), MAX_DIELECTRIC_F0)
    f0 = np.where(surfaces.metallic == 1.0, surfaces.f0, f0)
    clipped = np.asarray((wanted > 1.0 + 1e-6).any(axis=1) | (surfaces.base_color >= 1.0).any(axis=1))
    coat = np.minimum(surfaces.clearcoat * ratio.mean(axis=1), 1.0)
    return replace(surfaces, base_color=np.clip(wanted, 0.0, 1.0), f0=f0, clearcoat=coat), clipped
