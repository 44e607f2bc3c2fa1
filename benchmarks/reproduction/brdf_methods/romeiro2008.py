"""The bivariate model: the BRDF as a function of half and difference angle only [romeiro2008].

Of the full data, the mean over phi_d at each (theta_h, theta_d); the best that any method can do that
leaves phi_d out, in the sense of the plain mean.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance.completion import THETA_D
from benchmarks.reproduction.brdf_methods.case import DOMAIN, Case

Array = NDArray[np.float64]


def bivariate_model(case: Case) -> Array:
    """Return the mean over phi_d at the nodes of the domain, shape (n, 3), 1/sr."""
    cell = case.domain.i_h * len(THETA_D) + case.domain.i_d
    truth = case.samples(DOMAIN)
    n = np.bincount(cell)
    mean = np.stack([np.bincount(cell, channel) / np.maximum(n, 1) for channel in truth.T], axis=1)
    return np.asarray(mean[cell])
