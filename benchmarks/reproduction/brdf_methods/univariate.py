"""The slice theta_d = 0 alone, completed by what the program itself uses (`analysis.reflectance.completion`)."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.completion import complete_brdf
from analysis.reflectance.dictionary import Dictionary
from benchmarks.reproduction.brdf_methods.case import UNIVARIATE, Case

Array = NDArray[np.float64]

RELATIVE_SIGMA = 0.01
"""Error that samples without noise are taken to have."""


def completed(case: Case) -> Array:
    """Return the estimate at the nodes of the domain, shape (n, 3), 1/sr."""
    tables = complete_channels(case.places[UNIVARIATE].theta_h, case.samples(UNIVARIATE), case.dictionary)
    return np.stack([case.domain.from_table(table) for table in tables], axis=1)


def complete_channels(theta_h: Array, samples: Array, dictionary: Dictionary, noise: float = 0.0) -> Array:
    """Complete every channel of a slice.

    Parameters
    ----------
    theta_h : ndarray, shape (n,)
        Radians.
    samples : ndarray, shape (n, 3)
        1/sr.
    dictionary : Dictionary
    noise : float
        One sigma of the samples, relative, beyond `RELATIVE_SIGMA`.

    Returns
    -------
    ndarray, shape (3, n_h, n_d)
        Over `analysis.reflectance.completion.THETA_H` and `THETA_D`.
    """
    return np.stack([_complete(theta_h, curve, dictionary, np.hypot(noise, RELATIVE_SIGMA)) for curve in samples.T])


def _complete(theta_h: Array, curve: Array, dictionary: Dictionary, relative: float) -> Array:
    # A curve may be zero somewhere; a sigma may not.
    sigma = relative * np.maximum(np.abs(curve), 1e-3 * np.abs(curve).mean())
    return complete_brdf(theta_h, curve, sigma, dictionary).value
