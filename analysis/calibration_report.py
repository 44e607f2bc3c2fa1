"""The report of a calibration: one self-contained HTML page, and the same as JSON."""

from __future__ import annotations

import base64
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2

from analysis.calibration_checks import calibration_checks, coverage_of
from analysis.calibration_figures import calibration_figures
from analysis.calibration_parameters import parameters_of
from analysis.calibration_views import view_figures
from analysis.checks import Check, Status, by_severity, count
from analysis.error_budget import ErrorBudget
from analysis.session_calibration import Calibration
from analysis.session_facts import SessionFacts, facts_of
from instrument.session import Session

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
    with path.open("x", encoding="utf-8") as file:
        file.write(page)


def _template() -> jinja2.Template:
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("analysis", "data"), autoescape=True, undefined=jinja2.StrictUndefined
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
