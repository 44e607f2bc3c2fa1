"""The report of a calibration: one self-contained HTML page, and the same as JSON."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from analysis.calibration.light import Lighting
from analysis.calibration.session import Calibration
from analysis.camera.calibration import CameraCalibration
from analysis.camera.lens import LENS_NAMES
from analysis.reconstruction.error_budget import ErrorBudget
from analysis.reporting.calibration_checks import calibration_checks, coverage_of
from analysis.reporting.calibration_figures import calibration_figures
from analysis.reporting.calibration_file import view_figures
from analysis.reporting.checks import Check, Status, by_severity, count
from analysis.reporting.session_facts import SessionFacts, facts_of
from instrument.files.whole_file import write_whole
from instrument.session.session import Session

_HEADLINE = (
    "errors of the normals",
    "corners",
    "two halves of the views",
    "focal length",
    "light offset",
    "difference angle",
    "light power",
    "coverage of half angles",
    "response curve",
    "gain of the flat field",
)
"""Checks whose numbers users want first."""

_FALLOFF = ("light gradient x", "light gradient y", "vignetting r^2", "vignetting r^4", "lobe exponent")


@dataclass(frozen=True, slots=True)
class CalibrationReport:
    """A calibration, judged.

    Attributes
    ----------
    calibration : Calibration
    budget : ErrorBudget or None
        None where no stack was made.
    facts : SessionFacts
    checks : tuple of Check
        In the order of the calibration's steps.
    """

    calibration: Calibration
    budget: ErrorBudget | None
    facts: SessionFacts
    checks: tuple[Check, ...]

    @property
    def figures(self) -> dict[str, Any]:
        """The calibration's figures, with the error budget if there is one."""
        figures: dict[str, Any] = self.calibration.as_dict()
        if self.budget is not None:
            figures["error_budget_deg"] = self.budget.contributions
        return figures

    @property
    def verdict(self) -> str:
        """How many checks ended how."""
        passed, warned, failed = (count(self.checks, status) for status in Status)
        return f"{failed} FAIL, {warned} WARN, {passed} PASS"

    def as_dict(self) -> dict[str, Any]:
        """Return all that the page shows but for its pictures, as JSON has it."""
        reached = coverage_of(self.calibration, self.facts)
        return {
            **self.figures,
            "session": self.facts.title,
            "session_digest": self.facts.digest,
            "image_size_px": list(self.facts.image_size),
            "verdict": {status.value: count(self.checks, status) for status in Status},
            "checks": [check.as_dict() for check in by_severity(self.checks)],
            "parameters": [parameter.as_dict() for parameter in parameters_of(self.calibration)],
            "coverage": None if reached is None else reached.as_dict(),
            "views": list(view_figures(self.calibration)),
        }


def report_of(session: Session, calibration: Calibration, budget: ErrorBudget | None = None) -> CalibrationReport:
    """Judge a calibration of `session`.

    Parameters
    ----------
    session : Session
        Open; a few small values are read.
    calibration : Calibration
    budget : ErrorBudget or None
    """
    facts = facts_of(session, calibration)
    return CalibrationReport(calibration, budget, facts, calibration_checks(calibration, facts, budget))


def write_calibration_page(path: Path, report: CalibrationReport, title: str) -> None:
    """Write the page to a new file.

    Raises
    ------
    FileExistsError
        If there is a file already.
    NotWrittenError
        If the disk or the folder does not take it.
    """
    page = _template().render(
        title=title,
        verdict=report.verdict,
        worst=by_severity(report.checks)[0].status.value,
        headline=_headline(report.checks),
        checks=by_severity(report.checks),
        drawings=_drawings(report),
        parameters=parameters_of(report.calibration),
        budget=[] if report.budget is None else _by_size(report.budget),
        dropped=report.calibration.dropped,
        n_views=len(report.calibration.i_pose),
        n_complete=report.facts.n_complete,
    )
    write_whole(path, page)


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("analysis.reporting", "data"), autoescape=True, undefined=jinja2.StrictUndefined
    )
    return environment.get_template("calibration.html")


def _headline(checks: tuple[Check, ...]) -> list[Check]:
    by_name = {check.name: check for check in checks}
    return [by_name[name] for name in _HEADLINE if name in by_name]


def _drawings(report: CalibrationReport) -> list[tuple[str, str, bool]]:
    drawn = calibration_figures(report.calibration, report.facts, coverage_of(report.calibration, report.facts))
    return [(d.caption, base64.b64encode(d.png).decode("ascii"), d.is_wide) for d in drawn]


def _by_size(budget: ErrorBudget) -> list[tuple[str, float]]:
    return sorted(budget.contributions.items(), key=lambda item: -item[1])


@dataclass(frozen=True, slots=True)
class Parameter:
    """One unknown.

    Attributes
    ----------
    name, unit : str
    value, sigma : float
        And its standard deviation; NaN for one that was held, or of which none is known.
    """

    name: str
    unit: str
    value: float
    sigma: float

    def as_dict(self) -> dict[str, object]:
        """Return it as JSON has it."""
        return {"name": self.name, "unit": self.unit, "value": self.value, "sigma": self.sigma}

    @property
    def text(self) -> str:
        """The value with as many digits as its sigma supports."""
        if not (np.isfinite(self.sigma) and self.sigma > 0.0):
            return f"{self.value:.6g} {self.unit}".rstrip()
        digits = max(1 - int(np.floor(np.log10(self.sigma))), 0)
        return f"{self.value:.{digits}f} ± {self.sigma:.{digits}f} {self.unit}".rstrip()


def parameters_of(calibration: Calibration) -> tuple[Parameter, ...]:
    """Return the parameters of the lens, of the boards' print and of the light, those that there are."""
    found: list[Parameter] = []
    if calibration.camera is not None:
        found += _of_camera(calibration.camera)
    if calibration.lighting is not None:
        found += _of_light(calibration.lighting)
    return tuple(found)


def _of_camera(camera: CameraCalibration) -> Iterator[Parameter]:
    for name, value in zip(LENS_NAMES, camera.bundle.state.lens.values, strict=True):
        unit = "px" if name in {"f", "cx", "cy"} else ""
        yield Parameter(name, unit, float(value), camera.intrinsics_sigma.get(name, float("nan")))
    yield Parameter("scatter of the print", "mm", camera.bundle.noise.print_sigma, float("nan"))
    yield Parameter("what the lens model leaves, per axis", "px", camera.bundle.noise.floor, float("nan"))


def _of_light(lighting: Lighting) -> Iterator[Parameter]:
    for axis, value, sigma in zip("xyz", lighting.light_offset.value, lighting.light_offset.sigma, strict=True):
        yield Parameter(f"light offset {axis}", "mm", float(value), float(sigma))
    photometry = lighting.photometry
    values = (*photometry.gradient, *photometry.vignetting, photometry.lobe_exponent)
    sigmas = np.sqrt(np.diag(photometry.falloff_covariance))
    for name, value, sigma in zip(_FALLOFF, values, sigmas, strict=True):
        yield Parameter(name, "", float(value), float(sigma))
