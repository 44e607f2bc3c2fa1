"""Where an estimate of a BRDF is held against the truth, and by which error.

Nodes over half and difference angle as `analysis.reflectance.completion` has them, theta_h dense at the highlight as
in the MERL tables, at eight phi_d; every node counts alike, as every cell of such a table does. Nodes with the light
or the view within 10 deg of the horizon do not count, since the measurements are not to be relied on there
[ngan2005].
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.completion import THETA_D, THETA_H
from benchmarks.reproduction.brdf_materials import Angles

Array = NDArray[np.float64]

LOWEST_ELEVATION_DEG = 10.0

PHI_D = np.deg2rad(np.arange(0.0, 180.0, 22.5))

BANDS_DEG = ((0.0, 15.0), (15.0, 30.0), (30.0, 45.0), (45.0, 60.0), (60.0, 75.0))
"""Of theta_d; each includes its lower end, and the last one both."""

MAX_DEG = BANDS_DEG[-1][1]

OFFSET = 1e-3
"""1/sr, of the error in the logarithm [nielsen2015]."""


@dataclass(frozen=True, eq=False)
class Domain:
    """Nodes that count.

    Attributes
    ----------
    i_h, i_d, i_phi : ndarray of int, shape (n,)
        Indices into `THETA_H`, `THETA_D` and `PHI_D`.
    """

    i_h: NDArray[np.int64]
    i_d: NDArray[np.int64]
    i_phi: NDArray[np.int64]

    @classmethod
    def whole(cls) -> Domain:
        """Return all nodes up to `MAX_DEG` with light and view high enough."""
        shape = (len(THETA_H), len(THETA_D), len(PHI_D))
        i_h, i_d, i_phi = (grid.ravel() for grid in np.indices(shape))
        every = cls(i_h, i_d, i_phi)
        lowest = np.minimum(*every.angles.n_dot_l_and_v)
        # Whole degrees are meant: rounding must not lose the last band's end.
        high = lowest > np.sin(np.deg2rad(LOWEST_ELEVATION_DEG)) + 1e-9
        kept = high & (every.theta_d_deg <= MAX_DEG + 1e-6)
        return cls(i_h[kept], i_d[kept], i_phi[kept])

    @cached_property
    def angles(self) -> Angles:
        """Where the nodes are."""
        return Angles(THETA_H[self.i_h], THETA_D[self.i_d], PHI_D[self.i_phi])

    @property
    def theta_d_deg(self) -> Array:
        """Degrees, shape (n,)."""
        return np.rad2deg(self.angles.theta_d)

    @cached_property
    def weight(self) -> Array:
        """The cosine that errors are weighted by, shape (n,): light and view exchange, so the RMS of theirs."""
        n_dot_l, n_dot_v = self.angles.n_dot_l_and_v
        return np.sqrt(0.5 * (n_dot_l**2 + n_dot_v**2))

    def band(self, low_deg: float, high_deg: float) -> NDArray[np.bool_]:
        """Return which nodes lie in a band of theta_d, its upper end only where it is the last."""
        above = self.theta_d_deg >= low_deg - 1e-6
        last = high_deg >= MAX_DEG
        return above & (self.theta_d_deg <= high_deg + 1e-6 if last else self.theta_d_deg < high_deg - 1e-6)

    def up_to(self, theta_d_deg: float) -> NDArray[np.bool_]:
        """Return which nodes have a theta_d of this or less."""
        return self.theta_d_deg <= theta_d_deg + 1e-6

    def from_table(self, value: Array) -> Array:
        """Return a table over `THETA_H` and `THETA_D`, the same for all phi_d, at the nodes, shape (n,)."""
        return np.asarray(value[self.i_h, self.i_d])

    def relative_error(self, estimate: Array, truth: Array, where: NDArray[np.bool_] | None = None) -> float:
        """Return sqrt(sum ((e - g) cos)^2 / sum (g cos)^2) over nodes and channels [ngan2005].

        Parameters
        ----------
        estimate, truth : ndarray, shape (n, 3)
        where : ndarray of bool, shape (n,), or None
            None = all nodes.
        """
        nodes = slice(None) if where is None else where
        return relative_error(estimate[nodes], truth[nodes], self.weight[nodes])

    def log_error(self, estimate: Array, truth: Array, where: NDArray[np.bool_] | None = None) -> float:
        """Return the RMS of ln((e cos + offset) / (g cos + offset)) over nodes and channels [nielsen2015]."""
        nodes = slice(None) if where is None else where
        w = self.weight[nodes, None]
        ratio = np.log((estimate[nodes] * w + OFFSET) / (truth[nodes] * w + OFFSET))
        return float(np.sqrt(np.mean(ratio**2)))


def relative_error(estimate: Array, truth: Array, weight: Array) -> float:
    """Return sqrt(sum ((e - g) w)^2 / sum (g w)^2) of arrays of shape (n, 3) with weights of shape (n,)."""
    w = weight[:, None]
    return float(np.sqrt(np.sum(((estimate - truth) * w) ** 2) / np.sum((truth * w) ** 2)))
