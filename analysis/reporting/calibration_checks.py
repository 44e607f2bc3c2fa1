"""All checks of a calibration."""

from __future__ import annotations

import numpy as np

from analysis.calibration.session import Calibration
from analysis.reconstruction.error_budget import ErrorBudget
from analysis.registration.coverage import Coverage, coverage
from analysis.reporting.checks import Check, Limits, graded
from analysis.reporting.geometry_checks import geometry_checks
from analysis.reporting.light_checks import budget_check, light_checks
from analysis.reporting.radiometry_checks import radiometry_checks
from analysis.reporting.session_facts import SessionFacts

COVERAGE = Limits(0.0, np.inf, "no bin of half angles below 40 deg without enough views")


def calibration_checks(
    calibration: Calibration, facts: SessionFacts, budget: ErrorBudget | None = None
) -> tuple[Check, ...]:
    """Return the checks, in the order of the calibration's steps.

    Parameters
    ----------
    calibration : Calibration
    facts : SessionFacts
        Of its session.
    budget : ErrorBudget or None
        None where no stack was made.
    """
    checks = [*radiometry_checks(calibration.radiometry)]
    checks += geometry_checks(calibration, facts)
    checks += light_checks(calibration, facts)
    reached = coverage_of(calibration, facts)
    if reached is not None:
        checks.append(coverage_check(reached))
    if budget is not None:
        checks.append(budget_check(budget))
    return tuple(checks)


def coverage_of(calibration: Calibration, facts: SessionFacts) -> Coverage | None:
    """Return which half angles the views reach; None without an area."""
    camera, lighting = calibration.camera, calibration.lighting
    if camera is None or lighting is None or facts.area_mm is None:
        return None
    beside = np.einsum("nij,i->nj", camera.rotation, lighting.light_offset.value)
    return coverage(camera.camera_position, camera.camera_position + beside, facts.area_mm)


def coverage_check(reached: Coverage) -> Check:
    """Tell the half angles that the views leave out."""
    advice = reached.advice()
    number = (
        f"every slope up to 15 deg is seen within {reached.smallest_deg:.0f} deg of its highlight and "
        f"{reached.largest_deg:.0f} deg away from it"
    )
    return graded("coverage of half angles", float(len(advice)), COVERAGE, number, "; ".join(advice))
