"""What reflectance one unit of a result is: renderers want an absolute one, and a capture knows a relative one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.pixels.problem import tiles
from analysis.results.result import Result, diffuse_albedo

PAPER_REFLECTANCE = 0.85
"""Of the white of printed boards, where nobody measured it: office and photo paper have 0.8 to 0.9."""

BRIGHT_ALBEDO = 0.8
"""That the 99th percentile of the albedo becomes where the unit is anything."""


@dataclass(frozen=True, slots=True)
class Scale:
    """Reflectance of one unit of pi times the result's BRDF.

    Attributes
    ----------
    factor : float
    reason : str
        Where it comes from, for people.
    """

    factor: float
    reason: str


def reflectance_scale(result: Result, white_reflectance: float | None) -> Scale:
    """Return the scale of a result.

    Parameters
    ----------
    result : Result
    white_reflectance : float or None
        Of what the result takes for 1: the white of the boards in a calibrated session.
    """
    if white_reflectance is not None:
        return Scale(white_reflectance, "reflectance of white as given")
    if result.summary.calibration is not None:
        text = f"reflectance of white paper taken for {PAPER_REFLECTANCE:g}; --white-reflectance says otherwise"
        return Scale(PAPER_REFLECTANCE, text)
    parts = [
        diffuse_albedo(result.fits.select(tile)).max(axis=1) for tile in tiles(np.arange(len(result.fits.normals)))
    ]
    bright = float(np.nanpercentile(np.concatenate(parts), 99.0))
    text = (
        f"no white known: 99 % of the albedo made to stay below {BRIGHT_ALBEDO:g}; --white-reflectance says otherwise"
    )
    return Scale(BRIGHT_ALBEDO / bright if bright > 0.0 else 1.0, text)
