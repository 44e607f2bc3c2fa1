"""The dictionary-based fit of samples taken anywhere: non-negative least squares [hui2015, hui2017].

The BRDF is a sum of the dictionary's atoms with coefficients that are not negative, each channel by itself; columns are
scaled to unit norm at the samples. With samples of the full isotropic BRDF it is the method of [hui2015], with those of
the slice theta_d = 0 that of [hui2017].
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from benchmarks.reproduction.brdf_methods.case import DOMAIN, Case, Method

Array = NDArray[np.float64]


def from_samples_at(place: str) -> Method:
    """Return the method that takes the samples of one place."""

    def estimate(case: Case) -> Array:
        return case.atoms(DOMAIN) @ coefficients(case.atoms(place), case.samples(place))

    return estimate


def coefficients(atoms: Array, samples: Array) -> Array:
    """Fit samples by atoms.

    Parameters
    ----------
    atoms : ndarray, shape (n, n_atoms)
    samples : ndarray, shape (n, C)
        Both in 1/sr.

    Returns
    -------
    ndarray, shape (n_atoms, C)
    """
    norm = np.linalg.norm(atoms, axis=0)
    norm = np.where(norm > 0.0, norm, 1.0)
    return np.stack([nnls(atoms / norm, y)[0] / norm for y in samples.T], axis=1)
