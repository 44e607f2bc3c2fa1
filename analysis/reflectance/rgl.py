"""Measured isotropic BRDFs of the RGL database [dupuy2018]: evaluate, average.

The values of one theta_i stand over the unit square that the half vector is warped to by the density `vndf` of the
normals that are visible from omega_i, so that a highlight takes as much of the square as it has of the light. Times
ndf / (4 sigma) they are the BRDF times cos theta_o.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.atoms import bracket
from analysis.reflectance.merl import cell_angles
from analysis.reflectance.models import GRAZING, Array

_NOTICEABLE = 1e-3  # 1/sr: a reflectance of 0.3 %; what is darker is noise of the instrument


@dataclass(frozen=True, eq=False)
class RglBrdf:
    """One isotropic material.

    Attributes
    ----------
    theta_i : ndarray, shape (n_i,)
        Radians, ascending.
    sigma : ndarray, shape (n_s,)
        Projected area of the microfacets seen from theta, over sqrt(theta / 90 deg) from 0 to 1.
    ndf : ndarray, shape (n_n,)
        Density of the microfacets' normals in 1/sr, over the same.
    vndf : ndarray, shape (n_i, n_phi, n_theta)
        Density that warps the half vector; phi_h - phi_i from -pi to pi, theta_h as theta in `sigma`.
    rgb : ndarray, shape (n_i, 3, n_v, n_u)
        Over the unit square; zero in all three where nothing was measured.
    jacobian : bool
        Whether `rgb` is to be multiplied by ndf / (4 sigma).
    """

    theta_i: Array
    sigma: Array
    ndf: Array
    vndf: Array
    rgb: Array
    jacobian: bool

    @cached_property
    def _warp(self) -> _Warp:
        return _Warp.from_density(self.vndf)

    @cached_property
    def _nodes(self) -> Array:
        """`rgb`, and 1 where nothing was measured, shape (n_i, n_v, n_u, 4)."""
        missing = np.all(self.rgb == 0.0, axis=1, keepdims=True)
        return np.ascontiguousarray(np.moveaxis(np.concatenate([self.rgb, missing], axis=1), 1, -1))

    @property
    def theta_max(self) -> float:
        """The last theta_i that was measured, in radians.

        No instrument measures at 90 deg; the database repeats there what it has of the theta_i before.
        """
        repeated = len(self.rgb) > 1 and np.array_equal(self.rgb[-1], self.rgb[-2])
        return float(self.theta_i[-2 if repeated else -1])

    def evaluate(self, omega_i: Array, omega_o: Array) -> Array:
        """Return the BRDF in 1/sr, shape (..., 3); 0 at and below the horizon.

        The noise of the instrument is left in it: where a material is black, values may be negative.

        Parameters
        ----------
        omega_i, omega_o : ndarray, shape (..., 3)
            Unit vectors, (0, 0, 1) being the normal, broadcast against each other. What was measured is not
            quite reciprocal (`reciprocity_error`), so it matters which is which: omega_i is that of `theta_i`.
        """
        omega_i, omega_o = np.broadcast_arrays(omega_i, omega_o)
        value = np.zeros(omega_i.shape)
        above = (omega_i[..., 2] > 0.0) & (omega_o[..., 2] > 0.0)
        value[above] = self._lookup(omega_i[above], omega_o[above])[0]
        return value

    def _lookup(self, omega_i: Array, omega_o: Array) -> tuple[Array, NDArray[np.bool_]]:
        """Return the BRDF, shape (n, 3), and where it does not rest on nodes without a measurement."""
        omega_m = omega_i + omega_o
        theta_i, theta_m = _theta(omega_i), _theta(omega_m)
        phi = np.arctan2(omega_m[:, 1], omega_m[:, 0]) - np.arctan2(omega_i[:, 1], omega_i[:, 0])
        u_m = _theta_to_unit(theta_m)
        row = bracket(theta_i, self.theta_i)
        s_x, s_y = self._warp.invert(u_m, np.mod(phi / (2.0 * np.pi) + 0.5, 1.0), row)
        found = _bilinear(self._nodes, s_x, s_y, row)
        value = found[:, :3] / omega_o[:, 2:]
        if self.jacobian:
            sigma = _linear(self.sigma, _theta_to_unit(theta_i))
            value = value * (_linear(self.ndf, u_m) / (4.0 * sigma))[:, None]
        return value, found[:, 3] < 1e-6

    def average(self) -> tuple[Array, NDArray[np.uint8]]:
        """Average over what was measured of phi_d and of both orders of omega_i and omega_o, on MERL's grid.

        Returns
        -------
        mean : ndarray, shape (3, 90, 90)
            1/sr, not negative; NaN where no phi_d was measured.
        n_measured : ndarray, shape (3, 90, 90)
            How many of the 180 were, in either order.
        """
        theta_h, theta_d, phi_d = cell_angles()
        rows = [self._average_over_phi(h, theta_d, phi_d) for h in theta_h]
        mean = np.moveaxis(np.stack([mean for mean, _ in rows]), -1, 0)
        n_measured = np.stack([n for _, n in rows]).astype(np.uint8)
        return mean, np.repeat(n_measured[None], 3, axis=0)

    def _average_over_phi(self, theta_h: float, theta_d: Array, phi_d: Array) -> tuple[Array, NDArray[np.int64]]:
        """Return mean, shape (n_d, 3), and how many phi_d were measured, shape (n_d,)."""
        # Half a turn of phi_d exchanges omega_i and omega_o.
        omega_i, omega_o = _directions(theta_h, theta_d[:, None, None], phi_d + np.array([[0.0], [np.pi]]))
        lowest = np.minimum(omega_i[..., 2], omega_o[..., 2])
        measured = lowest >= max(np.cos(self.theta_max), GRAZING)
        value = np.zeros((*measured.shape, 3))
        value[measured], known = self._lookup(omega_i[measured], omega_o[measured])
        measured[measured] = known
        n = np.count_nonzero(measured, axis=(1, 2))[:, None]
        total = np.sum(value, axis=(1, 2), where=measured[..., None])
        mean = np.where(n > 0, np.maximum(total, 0.0) / np.maximum(n, 1), np.nan)
        return mean, np.count_nonzero(measured.any(axis=1), axis=1)


def reciprocity_error(brdf: RglBrdf) -> float:
    """Return the RMS of (f(i, o) - f(o, i)) / (their mean) for the mean of the channels.

    Over directions from 10 to 60 deg from the normal, each pair in all positions 10 deg of azimuth apart; pairs where
    the material is darker than 0.001 / sr are left out. NaN if all are.
    """
    theta = np.deg2rad(np.arange(10.0, 61.0, 5.0))
    phi = np.deg2rad(np.arange(0.0, 360.0, 10.0))
    omega_i = _spherical(theta[:, None, None], np.zeros(1))
    omega_o = _spherical(theta[:, None], phi)
    one, other = (np.mean(f, axis=-1) for f in (brdf.evaluate(omega_i, omega_o), brdf.evaluate(omega_o, omega_i)))
    mean = (one + other) / 2.0
    seen = mean > _NOTICEABLE
    return float(np.sqrt(np.mean(((one - other)[seen] / mean[seen]) ** 2))) if seen.any() else math.nan


def _directions(theta_h: float, theta_d: Array, phi_d: Array) -> tuple[Array, Array]:
    """Return omega_i and omega_o, shape (..., 3), at a half angle and difference angles in radians.

    Their half vector leans towards x; at phi_d = 0 omega_i leans further than it does.
    """
    x, y, z = np.moveaxis(_spherical(theta_d, phi_d), -1, 0)
    c, s = np.cos(theta_h), np.sin(theta_h)
    omega_i = np.stack([c * x + s * z, y, c * z - s * x], axis=-1)
    omega_o = np.stack([s * z - c * x, -y, c * z + s * x], axis=-1)
    return omega_i, omega_o


def _spherical(theta: Array, phi: Array) -> Array:
    theta, phi = np.broadcast_arrays(theta, phi)
    return np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=-1)


def _theta(omega: Array) -> Array:
    """Return the angle to the normal; omega of any length."""
    return np.arctan2(np.hypot(omega[:, 0], omega[:, 1]), omega[:, 2])


def _theta_to_unit(theta: Array) -> Array:
    return np.sqrt(theta / (np.pi / 2.0))


# Index of the node below each place, and how far on to the next it is.
_Step = tuple[NDArray[np.int64], Array]


@dataclass(frozen=True, eq=False)
class _Warp:
    """Densities on the unit square, bilinear between their nodes, and their integrals.

    Attributes
    ----------
    density : ndarray, shape (n, n_y, n_x)
        Each with the integral 1, a patch between nodes having the area 1.
    along_x : ndarray, shape (n, n_y, n_x)
        Integral over x from the edge to the node, in the row of the node.
    along_y : ndarray, shape (n, n_y)
        Integral over all x, and over y from the edge to the row.
    """

    density: Array
    along_x: Array
    along_y: Array

    @classmethod
    def from_density(cls, density: Array) -> _Warp:
        along_x = _running_integral(density)
        along_y = _running_integral(along_x[..., -1])
        total = along_y[:, -1:]
        return cls(density / total[..., None], along_x / total[..., None], along_y / total)

    def invert(self, x: Array, y: Array, row: _Step) -> tuple[Array, Array]:
        """Return where sampling by the density takes (x, y) from: the share of x at that y, and that of y.

        Between two theta_i density and integrals are mixed alike, so that the shares are those of the mixture.
        """
        _, n_y, n_x = self.density.shape
        (j, u), (k, v) = _patch(x, n_x), _patch(y, n_y)
        left, right = (_at_column(self.density, row, (k, v), column) for column in (j, j + 1))
        part = _at_column(self.along_x, row, (k, v), j) + _part_of_step(left, right, u)
        low, high = _at_row(self.along_x, row, k, -1), _at_row(self.along_x, row, k + 1, -1)
        whole = (1.0 - v) * low + v * high
        s_x = np.divide(part, whole, out=np.zeros_like(part), where=whole > 0.0)
        s_y = _at_row(self.along_y, row, k) + _part_of_step(low, high, v)
        return np.clip(s_x, 0.0, 1.0), np.clip(s_y, 0.0, 1.0)


def _running_integral(values: Array) -> Array:
    """Integrate from the first to each node of the last axis, linear between nodes that are 1 apart."""
    steps = np.cumsum((values[..., 1:] + values[..., :-1]) / 2.0, axis=-1)
    return np.concatenate([np.zeros_like(steps[..., :1]), steps], axis=-1)


def _part_of_step(at_0: Array, at_1: Array, x: Array) -> Array:
    """Integrate from 0 to x, at most 1, what goes linearly from `at_0` to `at_1`."""
    return x * (at_0 + x / 2.0 * (at_1 - at_0))


def _patch(x: Array, n: int) -> _Step:
    """Return the node below each x in 0 ... 1, of n nodes from 0 to 1, and how far on it is."""
    return bracket(x * (n - 1), np.arange(n, dtype=np.float64))


def _ends(step: _Step) -> tuple[tuple[NDArray[np.int64], Array], ...]:
    """Return both nodes of a step, each with its weight."""
    index, part = step
    return (index, 1.0 - part), (index + 1, part)


def _at_row(table: Array, row: _Step, *index: NDArray[np.int64] | int) -> Array:
    """Interpolate a table, shape (n, ...), over its rows only."""
    return np.asarray(sum(w * table[(i, *index)] for i, w in _ends(row)))


def _at_column(table: Array, row: _Step, y: _Step, j: NDArray[np.int64]) -> Array:
    """Interpolate a table, shape (n, n_y, n_x), over rows and y at column j."""
    k, v = y
    return (1.0 - v) * _at_row(table, row, k, j) + v * _at_row(table, row, k + 1, j)


def _bilinear(table: Array, x: Array, y: Array, row: _Step) -> Array:
    """Interpolate a table, shape (n, n_y, n_x, C), over rows, y and x in 0 ... 1."""
    _, n_y, n_x, _ = table.shape
    corners = product(_ends(row), _ends(_patch(y, n_y)), _ends(_patch(x, n_x)))
    return np.asarray(sum((w * w_y * w_x)[:, None] * table[i, k, j] for (i, w), (k, w_y), (j, w_x) in corners))


def _linear(table: Array, x: Array) -> Array:
    return np.interp(x * (len(table) - 1), np.arange(len(table)), table)
