"""A calibration that was kept as JSON is read back with all that there is to look at."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from analysis.reporting.calibration_checks import calibration_checks, coverage_of
from analysis.reporting.calibration_file import calibration_beside, read_calibration
from analysis.reporting.calibration_report import CalibrationReport
from analysis.reporting.checks import by_severity
from instrument.files.json_file import write_json
from instrument.files.validation import InvalidInputError
from tests.analysis.calibrations import calibration, camera, facts


def report_of(**changes: object) -> CalibrationReport:
    made = calibration(**changes)
    return CalibrationReport(made, None, facts(), calibration_checks(made, facts()))


@pytest.fixture
def path(tmp_path: Path) -> Path:
    write_json(tmp_path / "a.calibration.json", report_of().as_dict())
    return tmp_path / "a.calibration.json"


def test_what_was_kept_is_what_was_found(path: Path):
    report, saved = report_of(), read_calibration(path)
    for kept, check in zip(saved.checks, by_severity(report.checks), strict=True):
        assert (kept.name, kept.status, kept.number, kept.remedy) == (
            check.name,
            check.status,
            check.number,
            check.remedy,
        )
    assert saved.image_size == report.facts.image_size
    assert [view.i_pose for view in saved.views] == report.calibration.i_pose.tolist()
    for v, view in enumerate(saved.views):
        np.testing.assert_allclose(view.residuals, camera().residuals[v], atol=1e-5)
        np.testing.assert_allclose(view.corners, camera().corners[v].image_points, atol=1e-3)
        assert view.rms == pytest.approx(camera().view_rms[v])
    reached = coverage_of(report.calibration, report.facts)
    np.testing.assert_allclose(saved.coverage.all_over, reached.all_over)
    assert saved.coverage.advice() == reached.advice()


def test_a_view_tells_from_where_the_camera_looked(path: Path):
    for view in read_calibration(path).views:
        back = [np.sin(view.tilt) * np.cos(view.azimuth), np.sin(view.tilt) * np.sin(view.azimuth), np.cos(view.tilt)]
        np.testing.assert_allclose(back, view.camera_position / np.linalg.norm(view.camera_position), atol=1e-12)


def test_without_boards_the_checks_are_kept_alone(tmp_path: Path):
    write_json(tmp_path / "bare.json", report_of(camera=None, boards=None, lighting=None).as_dict())
    saved = read_calibration(tmp_path / "bare.json")
    assert (saved.views, saved.coverage) == ((), None)
    assert saved.checks


def test_only_a_calibration_of_the_very_frames_is_taken(path: Path):
    session = path.with_name("a.h5")
    assert calibration_beside(session, facts().digest).session_digest == facts().digest
    assert calibration_beside(session, "of other frames") is None
    assert calibration_beside(path.with_name("b.h5"), facts().digest) is None


def _without(values: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in values.items() if name != "views"}


def _infinite(values: dict[str, Any]) -> dict[str, Any]:
    values["views"][0]["residuals_px"][0][0] = None
    return values


def _short(values: dict[str, Any]) -> dict[str, Any]:
    values["views"][0]["residuals_px"].pop()
    return values


@pytest.mark.parametrize(
    ("spoil", "why"),
    [(_without, "views"), (_infinite, "not finite"), (_short, "corners and"), (lambda values: [values], "TypeError")],
)
def test_something_else_is_refused_with_the_reason(path: Path, spoil: Any, why: str):
    path.write_text(json.dumps(spoil(json.loads(path.read_text()))))
    with pytest.raises(InvalidInputError, match=why):
        read_calibration(path)


def test_a_file_that_is_gone_is_refused_too(tmp_path: Path):
    with pytest.raises(InvalidInputError, match="Calibrate again"):
        read_calibration(tmp_path / "gone.json")
