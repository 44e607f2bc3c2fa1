"""Optimised sampling: few directions chosen for a basis of measured materials [nielsen2015, xu2016].

x = ln((f w + offset) / (f_median w + offset)), w = n.l n.v, is what varies from material to material; its
principal components Q, scaled by their singular values, carry it from the sampled directions to all:
c = argmin |Q_s c - (x_s - mean_s)|^2 + eta |c|^2. The directions are those that make the condition number of Q_s small,
here chosen one after the other and then exchanged in turn. The choice of two views for a camera near the sample, with
many directions in each, which [xu2016] adds, is not: single directions are free to lie anywhere, which is easier.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from benchmarks.reproduction.brdf_domain import OFFSET, Domain
from benchmarks.reproduction.brdf_materials import Bank
from benchmarks.reproduction.brdf_methods.case import DOMAIN, Case

Array = NDArray[np.float64]

Indices = NDArray[np.int64]

N_DIRECTIONS = 20

ETA = 40.0

N_CANDIDATES = 300


@dataclass(frozen=True)
class LogRelativeBasis:
    """Materials in the logarithm relative to their median.

    Attributes
    ----------
    weight : ndarray, shape (n,)
    median : ndarray, shape (n,)
        1/sr.
    mean : ndarray, shape (n,)
    deviation : ndarray, shape (n, n_atoms)
        Of each atom from the mean.
    """

    weight: Array
    median: Array
    mean: Array
    deviation: Array

    @classmethod
    def from_atoms(cls, atoms: Array, weight: Array) -> LogRelativeBasis:
        """Build from atoms of shape (n, n_atoms), 1/sr."""
        median = np.median(atoms, axis=1)
        x = _mapped(atoms, weight[:, None], median[:, None])
        return cls(weight, median, x.mean(axis=1), x - x.mean(axis=1, keepdims=True))

    def scaled_components(self, n: int) -> Array:
        """Return the first `n` principal components times their singular values, shape (n_nodes, n)."""
        # From the small Gram matrix: the nodes are many times the atoms.
        _, V = np.linalg.eigh(self.deviation.T @ self.deviation)
        return np.asarray(self.deviation @ V[:, ::-1][:, :n])

    def estimate(self, nodes: Indices, samples: Array, eta: float = ETA) -> Array:
        """Return the BRDF at all nodes, shape (n, C), from samples of shape (n_s, C) at few.

        With all components, Q Q_s' is the product of the deviations, and c need not be written out:
        x = mean + Q Q_s' (Q_s Q_s' + eta)^-1 (x_s - mean_s).
        """
        w, median = self.weight[:, None], self.median[:, None]
        x_s = _mapped(samples, w[nodes], median[nodes]) - self.mean[nodes, None]
        D_s = self.deviation[nodes]
        K = D_s @ D_s.T + eta * np.eye(len(nodes))
        x = self.mean[:, None] + self.deviation @ (D_s.T @ np.linalg.solve(K, x_s))
        return np.asarray(np.maximum((np.exp(x) * (median * w + OFFSET) - OFFSET) / w, 0.0))


def _mapped(value: Array, weight: Array, median: Array) -> Array:
    return np.asarray(np.log((value * weight + OFFSET) / (median * weight + OFFSET)))


def choose_directions(components: Array, n: int, candidates: Indices) -> Indices:
    """Choose `n` of the candidate rows such that the condition number of `components` there is small.

    Parameters
    ----------
    components : ndarray, shape (n_nodes, n_components)
    n : int
    candidates : ndarray of int
        Rows to choose from.
    """
    Q = components[candidates]
    chosen = [int(np.argmax(np.sum(Q**2, axis=1)))]
    while len(chosen) < n:
        chosen.append(_best_beside(Q, chosen))
    for i in range(n):
        others = chosen[:i] + chosen[i + 1 :]
        other = _best_beside(Q, others)
        if np.linalg.cond(Q[[*others, other]]) < np.linalg.cond(Q[chosen]):
            chosen[i] = other
    return np.sort(candidates[chosen])


def _best_beside(Q: Array, chosen: list[int]) -> int:
    """Return the row that keeps the condition number least beside those chosen."""
    beside = np.broadcast_to(Q[chosen], (len(Q), len(chosen), Q.shape[1]))
    condition = np.linalg.cond(np.concatenate([beside, Q[:, None]], axis=1))
    condition[chosen] = np.inf
    return int(np.argmin(condition))


@lru_cache(maxsize=4)
def directions(bank: Bank, domain: Domain) -> Indices:
    """Return the nodes to sample, chosen once for all materials of the dictionary.

    Of measured materials the one to be tested is among them, which favours the method by one in a hundred.
    """
    basis = LogRelativeBasis.from_atoms(bank.atoms(DOMAIN), _weight(domain))
    every = np.linspace(0, len(basis.mean) - 1, N_CANDIDATES).round().astype(np.int64)
    return choose_directions(basis.scaled_components(N_DIRECTIONS), N_DIRECTIONS, every)


def optimised(case: Case) -> Array:
    """Return the estimate at the nodes of the domain, shape (n, 3), 1/sr."""
    basis = LogRelativeBasis.from_atoms(case.atoms(DOMAIN), _weight(case.domain))
    nodes = directions(case.bank, case.domain)
    return basis.estimate(nodes, case.samples(DOMAIN)[nodes])


def _weight(domain: Domain) -> Array:
    n_dot_l, n_dot_v = domain.angles.n_dot_l_and_v
    return n_dot_l * n_dot_v
