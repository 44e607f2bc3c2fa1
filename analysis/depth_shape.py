"""Plane and bowl of a depth map: what a light placed or powered wrongly leaves in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True)
class DepthShape:
    """Least-squares terms of depth, z = z_0 + tilt_x x + tilt_y y + bowl (x^2 + y^2) / 2 from the map's centre.

    Attributes
    ----------
    tilt_x, tilt_y : float
        Of the plane fitted alone, mm / mm; positive where depth rises to the right, or upwards.
    bowl : float
        Curvature in 1 / mm of the fit of plane and bowl; positive where the middle lies deepest.
    sag : float
        Height of that bowl's border above its middle, mm: at the known pixel farthest from the centre.
    rms, rms_without_plane, rms_without_bowl : float
        Root mean square in mm of depth about its mean, about the plane, about plane and bowl.
    """

    tilt_x: float
    tilt_y: float
    bowl: float
    sag: float
    rms: float
    rms_without_plane: float
    rms_without_bowl: float


def shape_terms(depth: Array, pitch: float) -> DepthShape:
    """Fit plane and bowl to `depth`, shape (height, width), mm, NaN = hole; `pitch` in mm.

    Terms that the known pixels do not determine (a tilt across a single row) are 0; without any all are NaN.
    """
    rows, columns = np.nonzero(np.isfinite(depth))
    if rows.size == 0:
        return DepthShape(*[float("nan")] * 7)
    height, width = depth.shape
    z = depth[rows, columns]
    # In units of the longer side, so that the columns are of one size and the rank can be told.
    side = max(height, width)
    unit = pitch * side
    x = (columns - 0.5 * (width - 1)) / side
    y = (0.5 * (height - 1) - rows) / side
    r_squared = x * x + y * y
    A = np.stack([np.ones_like(x), x, y, 0.5 * r_squared])
    flat, plane, bowl = (_fit(A[:n], z) for n in (1, 3, 4))
    return DepthShape(
        tilt_x=float(plane[1] / unit),
        tilt_y=float(plane[2] / unit),
        bowl=float(bowl[3] / unit**2),
        sag=float(0.5 * bowl[3] * r_squared.max()),
        rms=_rms(z - flat @ A[:1]),
        rms_without_plane=_rms(z - plane @ A[:3]),
        rms_without_bowl=_rms(z - bowl @ A),
    )


def _fit(A: Array, z: Array) -> Array:
    """Return the shortest of the least-squares solutions, from the moments."""
    return np.asarray(np.linalg.pinv(A @ A.T, rcond=1e-10, hermitian=True) @ (A @ z))


def _rms(residual: Array) -> float:
    return float(np.sqrt(np.mean(residual**2)))
