"""Colours of pictures: normals in false colour, radiance by the sRGB curve."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from instrument.pictures.srgb import srgb_from_linear

Array = NDArray[np.float64]


def normal_colours(normals: Array) -> Array:
    """Return the usual false colours (n + 1) / 2 of unit normals; unsolved pixels are black."""
    return np.asarray(np.nan_to_num(np.clip((normals + 1.0) / 2.0, 0.0, 1.0)))


def display_colours(radiance: Array, white: float | None = None) -> Array:
    """Return linear radiance (..., 1 or 3) as display colours, `white` (99th percentile) made 1, by the sRGB curve."""
    level = white or (float(np.nanpercentile(radiance, 99)) if np.isfinite(radiance).any() else 1.0)
    linear = np.nan_to_num(np.clip(radiance / max(level, 1e-30), 0.0, 1.0))
    curve = srgb_from_linear(linear)
    return np.asarray(np.broadcast_to(curve, (*curve.shape[:-1], 3)))
