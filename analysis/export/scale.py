"""What reflectance one unit of a result is: renderers want an absolute one, and a capture knows a relative one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from analysis.export.pixels import pixel_surfaces
from analysis.pixels.problem import tiles
from analysis.results.result import Result, diffuse_albedo

PAPER_REFLECTANCE = 0.85
"""Of the white of printed boards, where nobody measured it: office and photo paper have 0.8 to 0.9."""

BRIGHT_ALBEDOS = (0.8, 0.57, 0.4, 0.28, 0.2)
"""What the 99th percentile of the albedo may become where the unit is anything: the first at which highlights fit."""

_N_TRIED, _AS_GOOD, _NO_MATTER = 500, 1.1, 0.005


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
    albedo = _bright_albedo(result)
    if not albedo > 0.0:
        return Scale(1.0, "no white known, and the result is black")
    factors = [level / albedo for level in BRIGHT_ALBEDOS]
    best = factors[_first_that_fits(result, factors)]
    text = (
        f"no white known: 99 % of the albedo made to stay below {best * albedo:.2g}; --white-reflectance says otherwise"
    )
    return Scale(best, text)


def _bright_albedo(result: Result) -> float:
    """Return the 99th percentile of the albedo, in the result's unit."""
    fits = result.fits
    parts = [diffuse_albedo(fits.select(tile)).max(axis=1) for tile in tiles(np.arange(len(fits.normals)))]
    return float(np.nanpercentile(np.concatenate(parts), 99.0))


def _first_that_fits(result: Result, factors: list[float]) -> int:
    """Return the first of descending scales at which some pixels fit about as well as at the best of them.

    The reflectance of a dielectric's highlight is bounded, so that a glossy sample says how bright it can be.
    """
    solved = np.flatnonzero(np.isfinite(result.fits.normals[:, 0]))
    some = result.fits.select(solved[:: max(len(solved) // _N_TRIED, 1)])
    errors = np.array([float(np.median(pixel_surfaces(some, factor).error)) for factor in factors])
    return int(np.flatnonzero(errors <= _AS_GOOD * errors.min() + _NO_MATTER)[0])
