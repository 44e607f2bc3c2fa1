"""Checks of how counts became radiance."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from analysis.radiometry.conversion import RadiometryFindings
from analysis.radiometry.exposure_ratios import WARN_DEVIATION
from analysis.radiometry.response_fit import SLOPE_TOLERANCE
from analysis.radiometry.saturation import Saturation
from analysis.reporting.checks import Check, Limits, Status, graded, unknown

Array = NDArray[np.float64]

BLACK = Limits(0.5, np.inf, "within 0.5 DN")

SATURATION = Limits(0.01, np.inf, "within 1 % of the stated level")

CLIPPED = Limits(0.001, 0.05, "at most 0.1 % of the pixels; FAIL above 5 %")

RATIO = Limits(WARN_DEVIATION, np.inf, f"within {100 * WARN_DEVIATION:g} % of the reported ones")

SLOPE = Limits(SLOPE_TOLERANCE, np.inf, f"1 within {SLOPE_TOLERANCE:g}")

PREDICTION = Limits(0.1, 0.3, "RMS of light at most 10 %; FAIL above 30 %")

NOT_A_NUMBER = Limits(0.0, np.inf, "none")

_SIGMAS = 3.0


def radiometry_checks(found: RadiometryFindings) -> Iterator[Check]:
    """Yield the checks of counts that are linear, or of the curve that makes them so."""
    if found.response is None:
        yield from _black(found)
        if found.saturation is not None:
            yield _saturation(found.saturation, found.black_used)
        yield from _ratios(found)
        yield _noise(found)
    else:
        yield from _response(found)
    yield _clipped(found)
    yield _numbers(found)


def _black(found: RadiometryFindings) -> Iterator[Check]:
    by_exposures = _black_by_exposures(found)
    if found.black_dark is not None:
        yield _black_of_darks(found, found.black_dark)
    elif by_exposures is None:
        yield unknown(
            "black level",
            f"{_cell(found.black_used)} DN as stated; there are no darks to compare it with",
            BLACK.text,
            "take darks: the same exposure times with the light off and the lens covered",
        )
    if by_exposures is not None:
        yield by_exposures


def _black_of_darks(found: RadiometryFindings, dark: Array) -> Check:
    off, stated = np.abs(dark - found.black_used).max(), np.abs(dark - found.black_nominal).max()
    return graded(
        "black level",
        max(float(off), float(stated)),
        BLACK,
        f"darks {_cell(dark)} DN; used {_cell(found.black_used)}, stated {_cell(found.black_nominal)}",
        f"state a black level of {_cell(dark)} DN; the darks' own is used, which holds at their temperature only",
    )


def _black_by_exposures(found: RadiometryFindings) -> Check | None:
    """Judge by the light that exposures of different times disagree about; what noise explains passes."""
    error, sigma = found.ratios.black_error, found.ratios.black_sigma
    known = np.isfinite(error) & np.isfinite(sigma)
    if not known.any():
        return None
    weight = 1.0 / sigma[known] ** 2
    mean, of_mean = float(np.average(error[known], weights=weight)), float(1.0 / np.sqrt(weight.sum()))
    return graded(
        "black level by the exposures",
        max(abs(mean) - _SIGMAS * of_mean, 0.0),
        Limits(BLACK.warn, np.inf, f"{BLACK.text}, {_SIGMAS:g} sigma allowed for"),
        f"{mean:+.2f} ± {of_mean:.2f} DN too low, as exposures of different times have it",
        "take darks right before the capture, at its temperature; without them state a black level higher by this",
    )


def _saturation(found: Saturation, black: Array) -> Check:
    if not found.found.any():
        number = f"nothing piles up below the stated level of {found.nominal:g} DN"
        return graded("saturation level", 0.0, SATURATION, number, "")
    lowest = float(found.level[found.found].min())
    off = (found.nominal - lowest) / (found.nominal - float(black.mean()))
    return graded(
        "saturation level",
        off,
        SATURATION,
        f"clips at {_cell(found.level)} DN, stated {found.nominal:g}",
        f"state a saturation level of {lowest:g} DN; what was found is used",
    )


def _ratios(found: RadiometryFindings) -> Iterator[Check]:
    ratios = found.ratios
    known = np.isfinite(ratios.ratio)
    if not known.any():
        return
    worst = int(np.nanargmax(np.abs(ratios.deviation)))
    sigma = ratios.sigma[worst] / ratios.nominal[worst]
    yield graded(
        "exposure ratios",
        abs(float(ratios.deviation[worst])),
        RATIO,
        f"{100 * ratios.deviation[worst]:+.2f} ± {100 * sigma:.2f} % at the worst of {known.sum()}",
        "the camera's times are off: the ratios from the pictures are used instead; if they change from capture to "
        "capture, look for flicker, an automatic exposure or a mechanical shutter",
    )
    if known.all():
        yield _slope("linearity", ratios.slope, "look for a hidden tone curve or an automatic brightness")


def _slope(name: str, slope: float, remedy: str) -> Check:
    return graded(name, abs(slope - 1.0), SLOPE, f"slope of log light over log time {slope:.4f}", remedy)


def _noise(found: RadiometryFindings) -> Check:
    if found.noise_estimated:
        number = "gain and read noise are estimated from the pictures, or assumed where these cannot tell"
        remedy = "state conversion_gain and read_noise of the camera, or capture a bracket of three exposures"
        return unknown("noise model", number, "stated", remedy)
    return Check("noise model", Status.PASS, "gain and read noise are stated", 0.0, "stated", "")


def _response(found: RadiometryFindings) -> Iterator[Check]:
    if not found.response_predictions:
        number = "the curve was given; no bracket confirms it"
        remedy = "add a bracket of a still scene as [response] bracket, from black to clipped"
        yield unknown("response curve", number, PREDICTION.text, remedy)
        return
    errors = np.array([p.rms_relative for p in found.response_predictions])
    worst = int(np.nanargmax(errors))
    yield graded(
        "response curve",
        float(errors[worst]),
        PREDICTION,
        f"each of {len(errors)} pictures from the others: median RMS {100 * np.nanmedian(errors):.1f} %, "
        f"worst {100 * errors[worst]:.1f} % ({found.response_predictions[worst].exposure_time:.4g} s)",
        "the camera changed its curve or its light between the pictures: fix white balance, picture style and "
        "dynamic-range control, or use raw pictures",
    )
    remedy = "take the bracket with exposure, white balance and picture style set by hand: something followed the light"
    yield _slope("slope of the response", found.response_slope, remedy)


def _clipped(found: RadiometryFindings) -> Check:
    return graded(
        "clipped in every exposure",
        found.share_all_clipped,
        CLIPPED,
        f"{100 * found.share_all_clipped:.3f} % of the pixels",
        "add an exposure a quarter as long as the shortest, or lower the light; these pixels are bounds, no numbers",
    )


def _numbers(found: RadiometryFindings) -> Check:
    return graded(
        "values that are no numbers",
        float(found.n_nan),
        NOT_A_NUMBER,
        f"{found.n_nan} of {found.n_sampled} values looked at",
        "look for defective pixels or holes in the imported pictures; they are left out",
    )


def _cell(levels: Array) -> str:
    """Return the levels of a cell, one number where they are alike."""
    flat = np.ravel(levels)
    return f"{flat[0]:g}" if np.ptp(flat) == 0.0 else ", ".join(f"{v:.5g}" for v in flat)
