"""BRDF beyond what was seen: from a piece of the slice theta_d = 0 to all half and difference angles, with a band.

The materials of a dictionary are taken for draws from a Gaussian over the logarithm of the
cosine-weighted BRDF with an offset [nielsen2015]; conditioned on the piece that was seen, its mean is the
estimate and its covariance the band. All principal components stay in, since the noise and the evidence
decide how many of them the data can move. How far to trust it: docs/beyond-the-slice.md.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from analysis.reflectance.atoms import MATERIAL, AnyAtom, TabulatedAtom
from analysis.reflectance.dictionary import N_NODES, Dictionary
from analysis.reflectance.models import Array, Cosines, cosines_from_angles

THETA_H = np.deg2rad(np.linspace(0.0, np.sqrt(85.0), 46) ** 2)

THETA_D = np.deg2rad(np.linspace(0.0, 80.0, 17))

MIN_SAMPLES = 4

OFFSET = 1e-3
"""Added to the weighted BRDF before the logarithm, relative to its level on the seen slice: what is darker does not
count. Results are the same from 1e-2 to 1e-5."""

N_ALIKE = 20
"""Atoms that are as near to the curve as the 20th nearest weigh exp(-1/2): one Gaussian for all would have to span
paper and mirrors."""

MISFITS = np.geomspace(0.003, 0.6, 9)
"""Error of the dictionary on the curve, in log, among which the evidence chooses."""

# How far two published fits of the same 100 materials are from each other beyond what the slice tells, in log:
# a dictionary knows its own materials only, and this holds for others too (docs/beyond-the-slice.md).
_FORM_AT_60_DEG, _FORM_POWER, _FORM_PER_RADIAN = 0.35, 6, 0.3


@dataclass(frozen=True)
class CompletedBrdf:
    """One channel of a BRDF over half and difference angle.

    Attributes
    ----------
    theta_h : ndarray, shape (n_h,)
    theta_d : ndarray, shape (n_d,)
        Radians.
    value : ndarray, shape (n_h, n_d)
        In the unit of the curve, light and view symmetric about the half vector (phi_d = 90 deg).
    log_sigma : ndarray, shape (n_h, n_d)
        One sigma of log `value`.
    """

    theta_h: Array
    theta_d: Array
    value: Array
    log_sigma: Array

    def as_atom(self, name: str, channel: int = 0) -> TabulatedAtom:
        """Return the estimate as an atom of a dictionary."""
        return TabulatedAtom(name, self.theta_h, self.theta_d, self.value, channel)


def complete_brdf(theta_h: Array, curve: Array, sigma: Array, dictionary: Dictionary) -> CompletedBrdf:
    """Estimate the BRDF over all angles from samples of its slice theta_d = 0.

    With y = log(f n.l n.v / g + offset), g the level of the seen samples, and atoms weighted by their
    likeness to the curve: y = m + C' K^-1 (y_seen - m_seen) + e, K = cov(seen) + noise + misfit^2,
    C = cov(seen, all). What the dictionary misses on the slice, e = misfit^2 K^-1 (y_seen - m_seen), is taken for the
    material's own and the same at all theta_d, as a lobe's shape over theta_h nearly is. The result scales with the
    curve.

    Parameters
    ----------
    theta_h : ndarray, shape (n,)
        Half angles seen, radians, in any order.
    curve, sigma : ndarray, shape (n,)
        BRDF there, in any unit, and its standard deviation.
    dictionary : Dictionary
        Its materials are the prior; atoms of other kinds are left out.

    Raises
    ------
    ValueError
        If there are too few samples or materials, or the samples are no curve.
    """
    _check(theta_h, curve, sigma)
    weight = np.cos(theta_h) ** 2
    level = float(_level(curve * weight))
    # Noise may take a dark sample below zero, where there is no logarithm.
    seen = np.log(np.maximum(curve * weight / level, 0.0) + OFFSET)
    noise = (sigma * weight / level / np.exp(seen)) ** 2
    prior = _Prior.around(seen, theta_h, materials_of(dictionary))
    y, variance = prior.condition(seen, noise, theta_h)
    y = prior.bounded(y.reshape(len(THETA_H), len(THETA_D)), theta_h)
    weighted = np.maximum(np.exp(y) - OFFSET, 0.1 * OFFSET)
    log_sigma = np.sqrt(variance.reshape(y.shape)) * (weighted + OFFSET) / weighted
    return CompletedBrdf(
        THETA_H, THETA_D, weighted * level / node_weight(), np.hypot(log_sigma, _form_sigma(float(theta_h.max())))
    )


def _check(theta_h: Array, curve: Array, sigma: Array) -> None:
    if not theta_h.shape == curve.shape == sigma.shape or theta_h.ndim != 1:
        shapes = f"{theta_h.shape}, {curve.shape} and {sigma.shape}"
        raise ValueError(f"theta_h, curve and sigma have shapes {shapes}; must be rows of one length")
    if len(theta_h) < MIN_SAMPLES:
        raise ValueError(f"{len(theta_h)} samples of the curve; at least {MIN_SAMPLES} are needed")
    if not (np.isfinite(theta_h).all() and np.isfinite(curve).all() and np.all(np.isfinite(sigma) & (sigma > 0.0))):
        raise ValueError("theta_h, curve and sigma must be finite and sigma positive; leave other samples out")
    if theta_h.min() < 0.0 or theta_h.max() >= np.pi / 2:
        raise ValueError(
            f"theta_h goes from {theta_h.min():.4g} to {theta_h.max():.4g} rad; must be within 0 and pi / 2"
        )
    if np.median(curve) <= 0.0:
        raise ValueError("half of the curve or more is not positive: nothing was seen of the BRDF")


def materials_of(dictionary: Dictionary) -> tuple[AnyAtom, ...]:
    """Return the atoms that are materials.

    Raises
    ------
    ValueError
        If they are too few to be a prior.
    """
    atoms = tuple(atom for atom in dictionary.atoms if atom.kind == MATERIAL)
    if len(atoms) <= N_ALIKE:
        raise ValueError(
            f"dictionary {dictionary.name!r} has {len(atoms)} atoms that are materials; more than {N_ALIKE} are needed"
            ": take 'sgd', 'abc' or a file that `halfangle dictionary build` wrote"
        )
    return atoms


def node_cosines() -> Cosines:
    """Return the cosines at all nodes, shape (n_h, n_d), at phi_d = 90 deg, where n.l = n.v."""
    return cosines_from_angles(THETA_H[:, None], THETA_D, np.full((1, 1), np.pi / 2))[0]


def node_weight() -> Array:
    """Return n.l n.v at all nodes, shape (n_h, n_d)."""
    cosines = node_cosines()
    return cosines.n_dot_l * cosines.n_dot_v


# An atom at a time, so that dictionaries that share atoms share their tables.
@lru_cache(maxsize=2048)
def atom_on_nodes(atom: AnyAtom) -> Array:
    """Return an atom at all nodes, shape (n_h, n_d), 1/sr."""
    return atom.evaluate(node_cosines())


@lru_cache(maxsize=2048)
def _atom_on_slice(atom: AnyAtom) -> Array:
    return atom.evaluate(Cosines.on_slice(np.arccos(1.0 - np.linspace(0.0, 1.0, N_NODES) ** 2)))


def atoms_on_slice(atoms: tuple[AnyAtom, ...], theta_h: Array) -> Array:
    """Return the atoms on the slice, shape (n_atoms, n), 1/sr: linear between the nodes of a slice table."""
    x = np.sqrt(1.0 - np.cos(theta_h)) * (N_NODES - 1)
    i = np.minimum(x.astype(np.int64), N_NODES - 2)
    table = np.stack([_atom_on_slice(atom) for atom in atoms])
    return np.asarray(table[:, i] * (i + 1 - x) + table[:, i + 1] * (x - i))


@dataclass(frozen=True)
class _Prior:
    """A weighted Gaussian over the seen samples and all nodes.

    Attributes
    ----------
    log_nodes : ndarray, shape (n_atoms, n_h, n_d)
    mean_seen, mean : ndarray, shape (n,), (n_h n_d,)
    root_seen, root : ndarray, shape (n_atoms, n), (n_atoms, n_h n_d)
        Roots of the covariance: cov(a, b) = root_a' root_b.
    """

    log_nodes: Array
    mean_seen: Array
    mean: Array
    root_seen: Array
    root: Array

    @classmethod
    def around(cls, seen: Array, theta_h: Array, atoms: tuple[AnyAtom, ...]) -> _Prior:
        """Build from all atoms, each on its own level, weighted by likeness to `seen`."""
        on_slice = atoms_on_slice(atoms, theta_h) * np.cos(theta_h) ** 2
        level = _level(on_slice)
        log_slice = np.log(on_slice / level[:, None] + OFFSET)
        nodes = np.stack([atom_on_nodes(atom) for atom in atoms]) * node_weight()
        log_nodes = np.log(nodes / level[:, None, None] + OFFSET)
        distance = np.mean((log_slice - seen) ** 2, axis=1)
        weight = np.exp(-0.5 * distance / max(np.partition(distance, N_ALIKE)[N_ALIKE], 1e-6))
        weight /= weight.sum()
        flat = log_nodes.reshape(len(atoms), -1)
        mean_seen, mean, root = weight @ log_slice, weight @ flat, np.sqrt(weight)[:, None]
        return cls(log_nodes, mean_seen, mean, root * (log_slice - mean_seen), root * (flat - mean))

    def condition(self, seen: Array, noise: Array, theta_h: Array) -> tuple[Array, Array]:
        """Return mean and variance at all nodes given `seen` with variances `noise` at `theta_h`."""
        d = seen - self.mean_seen
        covariance = self.root_seen.T @ self.root_seen + np.diag(noise)
        misfit = max(MISFITS, key=lambda e: _log_evidence(covariance, float(e), d))
        L = np.linalg.cholesky(covariance + misfit**2 * np.eye(len(d)))
        M = solve_triangular(L, self.root_seen.T @ self.root, lower=True)
        z = solve_triangular(L, d, lower=True)
        missed = misfit**2 * solve_triangular(L, z, lower=True, trans="T")
        y = self.mean + M.T @ z + np.repeat(_at_nodes(theta_h, missed), len(THETA_D))
        variance = np.sum(self.root**2, axis=0) - np.sum(M**2, axis=0)
        # A curve that the dictionary misses on the slice is missed by as much elsewhere.
        return y, np.maximum(variance, 0.0) + misfit**2

    def bounded(self, y: Array, theta_h: Array) -> Array:
        """Keep `y` - `y`(nearest seen angle) within what some atom does.

        A Gaussian in the logarithm knows no bound: a steep slope at the smallest angle seen would go on
        to a peak that no material has.
        """
        nearest = np.clip(THETA_H, theta_h.min(), theta_h.max())
        at_nearest = _interpolation(nearest)
        of_atoms = self.log_nodes - (self.log_nodes[:, :, 0] @ at_nearest.T)[:, :, None]
        start = (at_nearest @ y[:, 0])[:, None]
        return np.asarray(start + np.clip(y - start, of_atoms.min(axis=0), of_atoms.max(axis=0)))


def _level(weighted: Array) -> NDArray[np.float64]:
    """Return the geometric mean over the last axis, with dark samples held up."""
    floor = 1e-3 * np.max(np.abs(weighted), axis=-1, keepdims=True) + np.finfo(float).tiny
    return np.asarray(np.exp(np.mean(np.log(np.maximum(weighted, floor)), axis=-1)))


def _log_evidence(covariance: Array, misfit: float, d: Array) -> float:
    """Return log N(d; 0, covariance + misfit^2), without its constant."""
    L = np.linalg.cholesky(covariance + misfit**2 * np.eye(len(d)))
    z = solve_triangular(L, d, lower=True)
    return float(-np.sum(np.log(np.diag(L))) - 0.5 * z @ z)


def _interpolation(theta_h: Array) -> Array:
    """Return the matrix that interpolates from the nodes to `theta_h`, linear in t = sqrt(1 - cos theta_h)."""
    t, nodes = np.sqrt(1.0 - np.cos(theta_h)), np.sqrt(1.0 - np.cos(THETA_H))
    return np.stack([np.interp(t, nodes, row) for row in np.eye(len(nodes))], axis=1)


def _at_nodes(theta_h: Array, curve: Array) -> Array:
    """Interpolate a curve to the nodes, linear in t = sqrt(1 - cos theta_h), constant beyond its ends."""
    order = np.argsort(theta_h)
    t, nodes = np.sqrt(1.0 - np.cos(theta_h[order])), np.sqrt(1.0 - np.cos(THETA_H))
    return np.interp(nodes, t, curve[order])


def _form_sigma(largest_theta_h: float) -> Array:
    """Return how far materials may be from the dictionary's, one sigma of the log, shape (n_h, n_d)."""
    over_theta_d = _FORM_AT_60_DEG * (THETA_D / np.deg2rad(60.0)) ** _FORM_POWER
    beyond = np.maximum(THETA_H - largest_theta_h, 0.0)
    return np.asarray(np.hypot(over_theta_d, _FORM_PER_RADIAN * beyond[:, None]))
