"""The materials of a palette beyond what was seen of them: all half and difference angles, with a band.

Up to the largest half angle seen a material keeps its curve; from there on, and off the slice, it follows
the shape that `extrapolation.complete_brdf` gives it, joined on without a step.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.atoms import TabulatedAtom
from analysis.reflectance.completion import THETA_D, CompletedBrdf, complete_brdf
from analysis.reflectance.dictionary import Dictionary, from_published
from analysis.reflectance.models import Cosines
from analysis.reflectance.palette import NODES, PALETTE, Palette, material_name

Array = NDArray[np.float64]

THETA_H = np.arccos(1.0 - np.linspace(0.0, 1.0, 192) ** 3)
"""Nodes over the half angle, rad: t = sqrt(1 - cos theta_h) = u^1.5 for even u, dense in the highlight."""

PRIOR = "sgd"
"""Dictionary whose materials say what the unseen angles look like."""

_N_SAMPLES = 48  # of a curve that its completion is asked from

_PEAK = 5.0  # times the curve at the smallest half angle seen: what nobody saw must not outshine it by more

_MIN_SIGMA = 0.003  # relative, of a curve: no dictionary follows it closer


@dataclass(frozen=True)
class MaterialBrdfs:
    """The materials over all angles.

    Attributes
    ----------
    atoms : tuple of TabulatedAtom
        Number k * C + c for channel c of material k.
    log_sigma : ndarray of float32, shape (K, C, n_h, n_d)
        One sigma of the logarithm of each, over `theta_h` and `theta_d`.
    theta_h, theta_d : ndarray
        Radians.
    seen : ndarray, shape (K, 2)
        Smallest and largest half angle at which each material was seen, rad.
    """

    atoms: tuple[TabulatedAtom, ...]
    log_sigma: NDArray[np.float32]
    theta_h: Array
    theta_d: Array
    seen: Array

    def dictionary(self, others: Dictionary) -> Dictionary:
        """Return the materials' dictionary, followed by the atoms of `others` beyond the palette's."""
        return Dictionary(PALETTE, (*self.atoms, *others.atoms[len(self.atoms) :]))


def complete_palette(palette: Palette, relative_sigma: Array, seen: Array) -> MaterialBrdfs:
    """Complete every material.

    Parameters
    ----------
    palette : Palette
    relative_sigma : ndarray, shape (K, C, N_NODES)
        One sigma of each curve, relative, over `palette.NODES`.
    seen : ndarray, shape (K, 2)
        Smallest and largest half angle at which each material was seen, rad.
    """
    n_materials, n_channels = palette.curve.shape[:2]
    prior = from_published(PRIOR)
    atoms, bands = [], []
    for k in range(n_materials):
        for ch in range(n_channels):
            curve, sigma = palette.curve[k, ch], np.maximum(relative_sigma[k, ch], _MIN_SIGMA)
            theta = np.linspace(seen[k, 0], seen[k, 1], _N_SAMPLES)
            t = np.sqrt(1.0 - np.cos(theta))
            value = np.interp(t, NODES, curve)
            completed = complete_brdf(theta, value, value * np.interp(t, NODES, sigma), prior)
            table, band = _joined(curve, sigma, completed, seen[k])
            atoms.append(TabulatedAtom(material_name(k), THETA_H, THETA_D, table, ch))
            bands.append(band)
    log_sigma = np.stack(bands).reshape(n_materials, n_channels, len(THETA_H), len(THETA_D))
    return MaterialBrdfs(tuple(atoms), log_sigma.astype(np.float32), THETA_H, THETA_D, seen)


def _joined(curve: Array, sigma: Array, completed: CompletedBrdf, seen: Array) -> tuple[Array, Array]:
    """Return the material's values and its band over (THETA_H, THETA_D)."""
    shape = completed.as_atom("shape")
    band = TabulatedAtom("band", completed.theta_h, completed.theta_d, completed.log_sigma)
    t = np.sqrt(1.0 - np.cos(THETA_H))
    # Below the smallest half angle seen a prior over materials would put a mirror's peak on any of them:
    # there the curve's own continuation stands, and the completion's ratio to its slice at the edge.
    inside = np.minimum(THETA_H, seen[1])
    on_slice = _at(shape, np.maximum(THETA_H, seen[0]), np.zeros(1))
    edge = _at(shape, np.clip(THETA_H, seen[0], seen[1]), np.zeros(1))
    # Beyond the largest, the completion's shape, scaled to meet the curve where it ends.
    own = np.interp(np.sqrt(1.0 - np.cos(inside)), NODES, curve)
    own = np.where(seen[0] > THETA_H, np.minimum(own, _PEAK * np.interp(seen[0], THETA_H, own)), own)
    value = own[:, None] * on_slice / edge
    ratio = _at(shape, np.maximum(THETA_H, seen[0]), THETA_D) / on_slice
    log_sigma = _at(band, np.maximum(THETA_H, seen[0]), THETA_D)
    known = inside == THETA_H
    log_sigma[known, 0] = np.interp(t[known], NODES, sigma)
    return value * ratio, log_sigma


def _at(atom: TabulatedAtom, theta_h: Array, theta_d: Array) -> Array:
    h, d = np.meshgrid(np.cos(theta_h), np.cos(theta_d), indexing="ij")
    return atom.evaluate(Cosines(h, d, h, h))
