"""Checks of the light, of the fall-off over the picture, and of what the errors do to the normals."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.session import Calibration
from analysis.light.flat_field import TEXTURE, WARN_GAIN, FlatField
from analysis.light.photometry import Photometry
from analysis.reconstruction.error_budget import ErrorBudget
from analysis.registration.lighting import LightOffset
from analysis.reporting.checks import Check, Limits, Status, graded
from analysis.reporting.session_facts import SessionFacts

Array = NDArray[np.float64]

STATED = Limits(3.0, np.inf, "within 3 sigma of the stated place")

THETA_D = Limits(30.0, 65.0, "at most 30 deg; FAIL above 65 deg")

POWER = Limits(0.05, np.inf, "at most 5 %")

WHITE = Limits(0.02, 0.1, "at most 2 % RMS; FAIL above 10 %")

GAIN = Limits(WARN_GAIN, np.inf, f"at most {WARN_GAIN:g} times")

FLAT = Limits(TEXTURE, TEXTURE, f"at most {100 * TEXTURE:g} % RMS")

ONE_CARD = Limits(0.1, np.inf, "within 10 % of the working distance")

BUDGET = Limits(0.5, 2.0, "at most 0.5 deg per axis; FAIL above 2 deg")

_REMEDIES = {
    "image noise": "longer exposures or more of them",
    "light power": "more white beside the sample, or a reference patch in every view",
    "light position": "measure the offset of the light from the lens, or put something glossy on the sample",
    "registration": "larger or more boards, in focus in every view",
    "fall-off": "more white around the sample, or flats of a blank card at three distances",
}


def light_checks(calibration: Calibration, facts: SessionFacts) -> Iterator[Check]:
    """Yield the checks of the light, if there is an area that it lights."""
    lighting = calibration.lighting
    distance = calibration.distance_mm
    if distance is not None and lighting is not None:
        yield offset(lighting.light_offset, facts)
        yield theta_d(lighting.light_offset, distance)
        yield spread(lighting.photometry, calibration.i_pose)
        if _are_times(facts.seconds):
            yield drift(lighting.photometry, facts.seconds)
        yield white(lighting.photometry)
        yield falloff(lighting.photometry)
    if calibration.flat is not None:
        yield from flat_checks(calibration.flat, distance)


def offset(light: LightOffset, facts: SessionFacts) -> Check:
    """Compare the light's place with the stated one."""
    (x, y, z), (sx, sy, sz) = light.value, light.sigma
    number = f"({x:.2f}, {y:.2f}, {z:.2f}) ± ({sx:.2f}, {sy:.2f}, {sz:.2f}) mm from the lens"
    off = 0.0
    if facts.light_offset is not None and facts.light_offset_sigma is not None:
        sigma = np.maximum(facts.light_offset_sigma[:2], 1e-6)
        off = float(np.max(np.abs(light.value[:2] - facts.light_offset[:2]) / sigma))
        number += ", stated ({:.1f}, {:.1f}, {:.1f})".format(*facts.light_offset)
    remedy = "measure the offset again: x to the right, y down, z forward, from the lens's entrance pupil"
    return graded("light offset", off, STATED, number, remedy)


def theta_d(light: LightOffset, distance: float) -> Check:
    """Tell half the angle between camera and light as the centre of the sample sees them, `distance` mm away."""
    across, depth = float(np.hypot(*light.value[:2])), distance - float(light.value[2])
    angle = np.rad2deg(np.arctan2(across, depth)) / 2.0
    sigma = np.rad2deg(float(np.max(light.sigma[:2])) / distance) / 2.0
    number = f"{angle:.2f} ± {sigma:.2f} deg at the centre, {across:.1f} mm beside the lens at {distance:.0f} mm"
    remedy = "move the light to the lens, or work from farther away: this is no one-camera-one-light geometry"
    return graded("difference angle", float(angle), THETA_D, number, remedy)


def spread(photometry: Photometry, i_pose: NDArray[np.int64]) -> Check:
    """Tell how much the power differs from view to view."""
    power = photometry.light_power / photometry.light_power.mean()
    sigma = float(np.sqrt(np.mean(photometry.light_power_sigma**2)))
    worst = int(np.abs(power - 1.0).argmax())
    number = (
        f"{100 * np.std(power):.2f} % from view to view (± {100 * sigma:.2f} % each), "
        f"pose {i_pose[worst]} {100 * (power[worst] - 1.0):+.1f} %"
    )
    remedy = "the power of each view is corrected; look for a loose supply, ambient light or an automatic exposure"
    return graded("light power", float(np.std(power)), POWER, number, remedy)


def drift(photometry: Photometry, seconds: Array) -> Check:
    """Fit a line to the power over time."""
    slope = np.polyfit(seconds - seconds.mean(), np.log(photometry.light_power), 1)[0]
    change = float(np.expm1(slope * np.ptp(seconds)))
    number = f"{100 * change:+.2f} % over {np.ptp(seconds):.0f} s"
    remedy = "the power of each view is corrected; let the light warm up before the capture"
    return graded("drift of the light", abs(change), POWER, number, remedy)


def white(photometry: Photometry) -> Check:
    """Tell what the model of the light leaves of the white."""
    number = f"{100 * photometry.rms:.2f} % RMS are left of the white"
    remedy = (
        "white that is dirty, glossy or shadowed, ambient light, or a light that is no small lamp: look at the map of "
        "the white's residuals"
    )
    return graded("white beside the sample", photometry.rms, WHITE, number, remedy)


def falloff(photometry: Photometry) -> Check:
    """Tell by how much the corner of the picture is brightened."""
    gain = float(np.exp(-sum(photometry.vignetting)))
    sigma = gain * float(np.sqrt(photometry.falloff_covariance[2:4, 2:4].sum()))
    number = f"vignetting of {gain:.3f} ± {sigma:.3f} in the corner of the picture, lobe exponent "
    number += f"{photometry.lobe_exponent:.2f} ± {np.sqrt(photometry.falloff_covariance[4, 4]):.2f}"
    remedy = "stop the lens down, or keep the sample away from the corners: errors grow with the correction"
    return graded("fall-off", max(gain, 1.0 / gain), GAIN, number, remedy)


def flat_checks(flat: FlatField, distance: float | None) -> Iterator[Check]:
    """Yield the checks of a flat field used at `distance` mm (None = not known)."""
    gain = flat.max_gain(flat.only_at_mm or distance or 1000.0)
    remedy = "stop the lens down or use a diffuser: the noise of the dark corners grows with the correction"
    yield graded("gain of the flat field", gain, GAIN, f"{gain:.2f} times at the worst pixel", remedy)
    number = f"{100 * flat.rms:.2f} % RMS are left of the card, {100 * flat.share_clipped:.3f} % of it clipped"
    yield graded("residual of the flat field", flat.rms, FLAT, number, "use a clean matte card, evenly in focus or not")
    if flat.only_at_mm is None:
        text = "cards at several distances tell vignetting and lobe apart"
        yield Check("flat field at other distances", Status.PASS, text, 0.0, "told apart", "")
    else:
        yield _one_card(flat.only_at_mm, distance)


def _one_card(only_at: float, distance: float | None) -> Check:
    off = float("nan") if distance is None else abs(only_at / distance - 1.0)
    at = "a distance that is not known" if distance is None else f"{distance:.0f} mm"
    number = f"one card at {only_at:.0f} mm: vignetting and lobe are confounded; the sample is at {at}"
    remedy = "add cards at two more distances, or hold the one at the distance of the sample"
    return graded("flat field at other distances", off, ONE_CARD, number, remedy)


def budget_check(budget: ErrorBudget) -> Check:
    """Tell how much of the calibration's errors reaches the normals, and which source dominates."""
    each = sorted(budget.contributions.items(), key=lambda item: -item[1])
    total = float(np.sqrt(sum(value**2 for value in budget.contributions.values())))
    number = f"{total:.3f} deg per axis: " + ", ".join(f"{name} {value:.3f}" for name, value in each)
    remedy = f"{budget.dominant} dominates: {_REMEDIES.get(budget.dominant, 'see its checks')}"
    return graded("errors of the normals", total, BUDGET, f"{number}; {budget.dominant} dominates", remedy)


def _are_times(seconds: Array) -> bool:
    return len(seconds) > 2 and bool(np.isfinite(seconds).all()) and float(np.ptp(seconds)) > 0.0
