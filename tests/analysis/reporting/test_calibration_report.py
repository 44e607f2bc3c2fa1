"""The page and the JSON of a calibration."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from analysis.camera.residual_arrows import by_region, exaggeration
from analysis.radiometry.exposure_ratios import ExposureRatios
from analysis.reconstruction.error_budget import ErrorBudget
from analysis.reporting.calibration_checks import calibration_checks
from analysis.reporting.calibration_figures import calibration_figures
from analysis.reporting.calibration_report import CalibrationReport, Parameter, write_calibration_page
from analysis.reporting.text import checks_text
from tests.analysis.calibrations import calibration, camera, facts, radiometry
from tests.analysis.radiometry.responses import srgb_response

BUDGET = ErrorBudget({"image noise": 0.02, "light position": 0.05})


def report_of(**changes: object) -> CalibrationReport:
    made = calibration(**changes)
    return CalibrationReport(made, BUDGET, facts(), calibration_checks(made, facts(), BUDGET))


@pytest.fixture(scope="module")
def page(tmp_path_factory: pytest.TempPathFactory) -> str:
    path = tmp_path_factory.mktemp("page") / "calibration.html"
    write_calibration_page(path, report_of(dropped=("pose 0: 3 board corners <dark>",)), "A title")
    return path.read_text()


def test_the_page_needs_nothing_beside_it(page: str) -> None:
    assert page.count("data:image/png;base64,") == 10
    assert "http" not in page.split("<style>")[1]
    assert "src=" not in page.replace('src="data:', "")


def test_the_page_holds_verdict_checks_parameters_budget_and_poses(page: str) -> None:
    report = report_of(dropped=("pose 0: 3 board corners <dark>",))
    assert report.verdict in page
    for check in report.checks:
        assert check.name in page
    for text in ("light position", "0.0500", "scatter of the print", "pose 0: 3 board corners &lt;dark&gt;"):
        assert text in page


def test_the_worst_checks_stand_first_on_the_page(page: str) -> None:
    table = page.split("<h2>Checks</h2>")[1]
    assert table.index("WARN") < table.index("PASS")


def test_a_page_that_is_there_is_kept(tmp_path: Path) -> None:
    (tmp_path / "page.html").write_text("mine")
    with pytest.raises(FileExistsError):
        write_calibration_page(tmp_path / "page.html", report_of(), "A title")


def test_the_json_holds_the_figures_and_the_checks() -> None:
    report = report_of()
    found = json.loads(json.dumps(report.as_dict()))
    assert report.figures.items() <= report.as_dict().items()
    assert found["corner_rms_px"] == pytest.approx(camera().rms)
    assert sum(found["verdict"].values()) == len(found["checks"]) == len(report.checks)
    assert {"name", "status", "number", "value", "threshold", "remedy"} == set(found["checks"][0])
    by_name = {p["name"]: p for p in found["parameters"]}
    assert by_name["f"]["sigma"] == pytest.approx(camera().intrinsics_sigma["f"])
    assert len(found["coverage"]["views_all_over"]) == 18


def test_only_what_there_is_is_drawn() -> None:
    bare = calibration(camera=None, boards=None, lighting=None, radiometry=radiometry(response=srgb_response()))
    drawn = list(calibration_figures(bare, facts(worst_preview=None), None))
    assert [d.caption for d in drawn] == ["Response curve"]
    assert drawn[0].png.startswith(b"\x89PNG")


@pytest.mark.parametrize("scale", [1e-3, 1.0, 37.0])
def test_arrows_are_drawn_at_a_round_number_of_times_and_stay_short(scale: float) -> None:
    residuals = scale * np.random.default_rng(0).standard_normal((500, 2))
    times = exaggeration(residuals, (640, 480))
    assert float(f"{times:.0e}") == pytest.approx(times)
    assert 0.01 * 640 < times * np.percentile(np.linalg.norm(residuals, axis=1), 95) <= 0.04 * 640 + 1e-9


def test_a_parameter_shows_the_digits_that_its_sigma_supports() -> None:
    assert Parameter("f", "px", 1849.70553, 0.0224).text == "1849.706 ± 0.022 px"
    assert Parameter("m", "", 2.0, 13.0).text == "2 ± 13"
    assert Parameter("k3", "", 0.0, float("nan")).text == "0"


def test_the_text_tells_what_is_not_right_and_counts_the_rest() -> None:
    text = checks_text(report_of(dropped=("pose 0: dark",)))
    assert text.splitlines()[0].startswith("WARN  poses left out: 1 of 20: pose 0: dark (allowed: none")
    assert "Next: see that the boards are in the picture" in text
    assert "calibration checks: 0 FAIL, 2 WARN, 24 PASS" in text
    assert "corners:" not in text


def test_a_failure_is_told_loudly() -> None:
    assert "THE CALIBRATION FAILED" in checks_text(report_of(camera=replace(camera(), halves_z={"f": 9.0})))
    assert "THE CALIBRATION FAILED" not in checks_text(report_of())


def test_without_files_to_write_every_check_is_told() -> None:
    report = report_of()
    text = checks_text(report, all_checks=True)
    assert all(check.name in text for check in report.checks)


def test_what_corners_of_a_region_have_in_common_is_told_apart_from_their_scatter() -> None:
    rng = np.random.default_rng(0)
    points = rng.uniform(0, [639, 479], (20_000, 2))
    residuals = 0.1 * rng.standard_normal((20_000, 2))
    residuals[points[:, 0] > 319.5] += [0.05, 0.0]
    centres, means, errors = by_region(points, residuals, (640, 480))
    assert len(centres) == 48
    biased = centres[:, 0] > 319.5
    strength = np.linalg.norm(means, axis=1) / errors
    assert strength[biased].min() > 3.5 > strength[~biased].max()
    np.testing.assert_allclose(means[biased].mean(axis=0), [0.05, 0.0], atol=0.005)


def test_every_check_stands_in_the_documentation() -> None:
    text = (Path(__file__).parents[3] / "docs/calibration.md").read_text(encoding="utf-8")
    without_darks = radiometry(black_dark=None, ratios=ExposureRatios.of_one_exposure())
    behind_a_curve = radiometry(response=srgb_response())
    checks = [c for r in (radiometry(), without_darks, behind_a_curve) for c in report_of(radiometry=r).checks]
    assert {c.name for c in checks if f"| {c.name} |" not in text} == set()
