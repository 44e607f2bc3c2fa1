"""A calibration in the window: where it was seen from, what is left of the corners, the checks."""

import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from PySide6.QtCore import QPointF, Qt
from pytestqt.qtbot import QtBot

from analysis.reporting.calibration_checks import calibration_checks
from analysis.reporting.calibration_report import CalibrationReport
from analysis.reporting.checks import by_severity
from gui.calibration.checks_table import OUTCOMES
from gui.calibration.tab import CalibrationTab
from instrument.files.json_file import write_json
from instrument.session.session import Session
from protocols.capture.engine import capture
from tests.analysis.calibrations import calibration, camera, facts
from tests.protocols.fakes import FakeBench, protocol_config, rig_config


def keep_calibration(session: Path, **changes: Any) -> CalibrationReport:
    """Write beside a session what `halfangle calibrate --json` would."""
    with Session(session) as opened:
        of = facts(digest=opened.digest())
    made = calibration(**changes)
    report = CalibrationReport(made, None, of, calibration_checks(made, of))
    write_json(session.with_name("a.calibration.json"), report.as_dict())
    return report


@pytest.fixture(scope="module")
def captured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("session") / "a.h5"
    capture(rig_config(), protocol_config(count=3), path, devices=FakeBench().devices)
    return path


@pytest.fixture
def session(captured: Path, tmp_path: Path) -> Path:
    shutil.copy(captured, tmp_path / "a.h5")
    return tmp_path / "a.h5"


@pytest.fixture
def tab(qtbot: QtBot) -> Iterator[CalibrationTab]:
    tab = CalibrationTab()
    qtbot.addWidget(tab)
    tab.resize(900, 700)
    tab.show()
    yield tab
    tab.close_job()


@pytest.fixture
def calibrated(tab: CalibrationTab, session: Path, qtbot: QtBot) -> CalibrationTab:
    keep_calibration(session, dropped=("pose 0: dark",))
    with qtbot.waitSignal(tab.shown, timeout=20_000):
        tab.open_session(session)
    return tab


def test_the_checks_stand_with_the_worst_first_in_words_and_signs(calibrated: CalibrationTab):
    table, checks = calibrated.checks_table, calibrated.calibration.checks
    assert table.rowCount() == len(checks)
    for i_row, check in enumerate(by_severity(checks)):
        cells = [table.item(i_row, i_column).text() for i_column in range(5)]
        assert cells == [check.name, OUTCOMES[check.status], check.number, check.threshold, check.remedy]
    assert "0 FAIL, 2 WARN" in calibrated.state_label.text()


def test_every_view_is_a_dot_at_its_azimuth_and_tilt(calibrated: CalibrationTab):
    x, y = calibrated.directions.dots.getData()
    place = camera().camera_position
    tilt = np.rad2deg(np.arccos(place[:, 2] / np.linalg.norm(place, axis=1)))
    np.testing.assert_allclose(np.hypot(x, y), tilt, atol=1e-4)
    np.testing.assert_allclose(np.arctan2(y, x), np.arctan2(place[:, 1], place[:, 0]), atol=1e-3)


def arrows(tab: CalibrationTab) -> np.ndarray:
    """Return start and tip of each arrow that is brought out, shape (n, 2, 2)."""
    return np.stack(tab.residuals.arrows.getData(), axis=1).reshape(-1, 6, 2)[:, :2]


def test_the_arrows_are_the_residuals_so_many_times_as_long_as_is_said(calibrated: CalibrationTab):
    drawn = arrows(calibrated)
    np.testing.assert_allclose(
        (drawn[:, 1] - drawn[:, 0]) / calibrated.residuals.times, np.concatenate(camera().residuals), atol=1e-4
    )
    assert f"arrows {calibrated.residuals.times:g} times as long" in calibrated.pose_label.text()
    start, tip = np.stack(calibrated.residuals.scale.getData(), axis=1)[:2]
    length = (tip[0] - start[0]) / calibrated.residuals.times
    assert calibrated.residuals.scale_text.toPlainText() == f"{length:g} px"


def click(tab: CalibrationTab, plot: Any, at: np.ndarray, qtbot: QtBot) -> None:
    scene = plot.getPlotItem().vb.mapViewToScene(QPointF(*at))
    qtbot.mouseMove(plot.viewport(), plot.mapFromScene(scene))
    qtbot.mouseClick(plot.viewport(), Qt.MouseButton.LeftButton, pos=plot.mapFromScene(scene))


def test_a_pose_picked_in_the_coverage_shows_its_residuals(calibrated: CalibrationTab, qtbot: QtBot):
    x, y = calibrated.directions.dots.getData()
    click(calibrated, calibrated.directions, np.array([x[4], y[4]]), qtbot)
    np.testing.assert_allclose(arrows(calibrated)[:, 0], camera().corners[4].image_points, atol=1e-3)
    assert calibrated.pose_box.currentText() == "pose 5"
    assert calibrated.pose_label.text().startswith("pose 5: tilt ")


def test_a_corner_picked_in_the_picture_marks_its_pose(calibrated: CalibrationTab, qtbot: QtBot):
    corner = camera().corners[7].image_points[3]
    click(calibrated, calibrated.residuals, corner, qtbot)
    view = calibrated.pose_box.currentIndex() - 1
    assert np.min(np.linalg.norm(camera().corners[view].image_points - corner, axis=1)) < 3.0
    np.testing.assert_allclose(np.ravel(calibrated.directions.mark.getData()), calibrated.directions._places[view])


def test_poses_are_gone_through_with_the_arrow_keys(calibrated: CalibrationTab, qtbot: QtBot):
    for key, index in ((Qt.Key.Key_Right, 1), (Qt.Key.Key_Right, 2), (Qt.Key.Key_Left, 1), (Qt.Key.Key_Left, 1)):
        qtbot.keyClick(calibrated.directions, key)
        assert calibrated.pose_box.currentIndex() == index
    calibrated.pose_box.setCurrentIndex(0)
    assert len(arrows(calibrated)) == sum(len(r) for r in camera().residuals)


def test_a_session_that_was_never_calibrated_says_so_and_offers_it(tab: CalibrationTab, session: Path, qtbot: QtBot):
    assert not tab.calibrate_button.isEnabled()
    with qtbot.waitSignal(tab.shown, timeout=20_000):
        tab.open_session(session)
    assert "was never calibrated" in tab.state_label.text()
    with qtbot.waitSignal(tab.calibrate_asked) as asked:
        tab.calibrate_button.click()
    assert asked.args == [session]


def test_without_boards_the_checks_are_shown_alone(tab: CalibrationTab, session: Path, qtbot: QtBot):
    keep_calibration(session, camera=None, boards=None, lighting=None)
    with qtbot.waitSignal(tab.shown, timeout=20_000):
        tab.open_session(session)
    assert tab.checks_table.rowCount() > 0
    assert len(arrows(tab)) == 0
    qtbot.keyClick(tab.directions, Qt.Key.Key_Right)
    assert tab.pose_box.count() == 1


@pytest.mark.parametrize("content", [b"nothing", None])
def test_what_is_no_session_is_a_message_and_shows_nothing_old(
    calibrated: CalibrationTab, tmp_path: Path, qtbot: QtBot, content: bytes | None
):
    if content:
        (tmp_path / "x.h5").write_bytes(content)
    with qtbot.waitSignal(calibrated.failed, timeout=20_000) as failed:
        calibrated.open_session(tmp_path / "x.h5")
    assert "x.h5" in failed.args[0]
    assert calibrated.calibration is None
    assert calibrated.checks_table.rowCount() == 0


def test_a_calibration_that_is_damaged_is_a_message(tab: CalibrationTab, session: Path, qtbot: QtBot):
    session.with_name("a.calibration.json").write_text("{")
    with qtbot.waitSignal(tab.failed, timeout=20_000) as failed:
        tab.open_session(session)
    assert "Calibrate again" in failed.args[0]
