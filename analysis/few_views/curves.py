"""The log curves of the materials: a table for the kernels, a prior from published materials, a step by the samples."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import PchipInterpolator

from analysis.reflectance.dictionary import from_published
from analysis.reflectance.models import Cosines

Array = NDArray[np.float64]

NODES_DEG = (0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13.5, 15, 16.5, 18, 20, 22, 25, 28, 32, 37, 43, 51, 62, 75, 88)
"""Half angles at which a curve is unknown, dense in the highlight."""

NODES = np.sqrt(1.0 - np.cos(np.deg2rad(np.array(NODES_DEG, np.float64))))
"""The same in t = sqrt(1 - cos theta_h)."""

N_TABLE = 512
"""Entries of a table, uniform in t from 0 to 1."""

PRIORS = ("sgd", "abc")
"""Published tables of materials whose curves say what is likely where few samples decide."""

_DARKEST = 1e-3  # 1/sr: below, the published fits are no measurements

_LEVEL_SIGMA, _OWN_SIGMA = 5.0, 0.02  # of log F: its level is free; at each node, beyond what materials have in common

_INDEPENDENT = 0.1  # share of the samples that count: neighbours' errors are alike

_MAX_STEP = 1.0  # of log F at any node


@dataclass(frozen=True, eq=False)
class Curves:
    """Log curves of K materials in C channels.

    Attributes
    ----------
    value : ndarray, shape (K, C, J)
        log F at `NODES`.
    """

    value: Array

    def table(self) -> Array:
        """Return the curves as the kernels take them, shape (K, C, N_TABLE)."""
        t = np.minimum(np.linspace(0.0, 1.0, N_TABLE), NODES[-1])
        return np.asarray(PchipInterpolator(NODES, self.value, axis=-1)(t))

    def shifted(self, by: Array) -> Curves:
        """Return the curves brighter by the factors exp(`by`), shape (K, C)."""
        return Curves(self.value + by[..., None])


@cache
def curve_prior() -> tuple[Array, Array]:
    """Return mean, shape (J,), and precision, (J, J), of a log curve whose level is free."""
    cosines = Cosines.on_slice(np.deg2rad(np.minimum(NODES_DEG, 80.0)))
    f = np.concatenate([from_published(name).evaluate(cosines) for name in PRIORS], axis=-1).T
    y = np.log(np.maximum(f, _DARKEST))
    y -= y.mean(axis=1, keepdims=True)
    mean = y.mean(axis=0)
    covariance = (y - mean).T @ (y - mean) / len(y)
    covariance += _OWN_SIGMA**2 * np.eye(len(NODES)) + _LEVEL_SIGMA**2
    return mean, np.linalg.inv(covariance)


def curve_step(curves: Curves, S: Array, rhs: Array) -> Curves:
    """Return the curves after one Gauss-Newton step.

    Parameters
    ----------
    curves : Curves
    S, rhs : ndarray, shapes (K, C, J, J) and (K, C, J)
        Of `kernels.curve_equations`; a material that no sample speaks of keeps its curve.
    """
    mean, precision = curve_prior()
    value = curves.value.copy()
    for k, c in np.ndindex(S.shape[:2]):
        if not rhs[k, c].any():
            continue
        own = _INDEPENDENT * _symmetric(S[k, c])
        pull = _INDEPENDENT * rhs[k, c] - precision @ (value[k, c] - mean)
        step = np.linalg.solve(own + precision, pull)
        value[k, c] += step * min(1.0, _MAX_STEP / max(float(np.abs(step).max()), 1e-12))
    return Curves(value)


def curve_sigma(S: Array) -> Array:
    """Return one sigma of each log curve freed of its level, shape (K, C, J), from the equations at the end."""
    _, precision = curve_prior()
    n = S.shape[-1]
    sigma = np.empty(S.shape[:3])
    for k, c in np.ndindex(S.shape[:2]):
        covariance = np.linalg.inv(_INDEPENDENT * _symmetric(S[k, c]) + precision)
        # The level trades against the albedos: what is known is the curve against its mean where it is known best.
        w = 1.0 / np.diag(covariance)
        free = np.eye(n) - w / w.sum()
        sigma[k, c] = np.sqrt(np.diag(free @ covariance @ free.T))
    return sigma


def _symmetric(S: Array) -> Array:
    return np.asarray(np.triu(S) + np.triu(S, 1).T)
