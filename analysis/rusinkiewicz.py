"""Half and difference angles [rusinkiewicz1998]: from a place in a BRDF's table to the cosines that models want."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.reflectance import GRAZING, Array, Cosines


def cosines_from_angles(theta_h: Array, theta_d: Array, phi_d: Array) -> tuple[Cosines, NDArray[np.bool_]]:
    """Return the cosines at angles in radians, and where light and view are both above the horizon.

    n.l = cos theta_h cos theta_d - sin theta_h sin theta_d cos phi_d; n.v is the same with phi_d + pi.

    Parameters
    ----------
    theta_h, theta_d, phi_d : ndarray
        Broadcast against each other.
    """
    level = np.cos(theta_h) * np.cos(theta_d) * np.ones_like(phi_d)
    lean = np.sin(theta_h) * np.sin(theta_d) * np.cos(phi_d)
    n_dot_l, n_dot_v = level - lean, level + lean
    cosines = Cosines(
        n_dot_h=np.broadcast_to(np.maximum(np.cos(theta_h), GRAZING), level.shape),
        cos_d=np.broadcast_to(np.cos(theta_d), level.shape),
        # Rounding takes cos^2 + sin^2 beyond 1, where there is no arccosine.
        n_dot_l=np.clip(n_dot_l, GRAZING, 1.0),
        n_dot_v=np.clip(n_dot_v, GRAZING, 1.0),
    )
    return cosines, np.minimum(n_dot_l, n_dot_v) > 0.0
