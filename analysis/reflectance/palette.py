"""A palette: the few materials of a scene, each one curve a channel over the half angle.

A pixel is a non-negative mixture of few of them, the same shares in every channel. Curves are tabulated on
the nodes of `dictionary.SliceTable`, uniform in t = sqrt(1 - cos theta_h).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.atoms import TabulatedAtom
from analysis.reflectance.dictionary import N_NODES, Dictionary

Array = NDArray[np.float64]

MAX_MATERIALS = 3
"""Most materials that a pixel may mix; a fourth bought 2 % of normal error (docs/decisions/0009)."""

MATERIAL_GAIN = 6.0
"""Fall of chi-square for which a pixel takes one more material: a curve that it borrows is no free parameter,
but one that is slightly wrong earns chi-square anywhere."""

PALETTE = "palette"
"""Name of the dictionary that a palette is; its atoms come first, number k * C + c for channel c of material k."""

NODES = np.linspace(0.0, 1.0, N_NODES)
"""Nodes in t."""


@dataclass(frozen=True, eq=False)
class Palette:
    """The materials of a scene.

    Attributes
    ----------
    curve : ndarray, shape (K, C, N_NODES)
        BRDF on the slice theta_d = 0 over `NODES`, 1/sr; positive.
    """

    curve: Array

    @property
    def n_materials(self) -> int:
        """Number of materials K."""
        return len(self.curve)

    def tables(self) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Return the curves and their derivatives to cos theta_h, each of shape (C, N_NODES, K)."""
        slope = np.gradient(self.curve, 1.0 - NODES**2, axis=-1)
        value, derivative = (np.ascontiguousarray(a.transpose(1, 2, 0), np.float32) for a in (self.curve, slope))
        return value, derivative

    def select(self, materials: NDArray[np.int64] | list[int]) -> Palette:
        """Return the palette of these materials only."""
        return Palette(self.curve[np.asarray(materials, np.int64)])

    def joined(self, other: Palette) -> Palette:
        """Return the palette of both."""
        return Palette(np.concatenate([self.curve, other.curve]))

    @cached_property
    def dictionary(self) -> Dictionary:
        """Materials as atoms, number k * C + c for channel c of material k."""
        theta_h = np.arccos(1.0 - NODES**2)
        atoms = tuple(
            TabulatedAtom(material_name(k), theta_h, np.zeros(1), curve[:, None], channel)
            for k, channels in enumerate(self.curve)
            for channel, curve in enumerate(channels)
        )
        return Dictionary(PALETTE, atoms)


def material_name(k: int) -> str:
    """Return the name that the atoms of material `k` have; by it they are known among a dictionary's other atoms."""
    return f"material {k}"
