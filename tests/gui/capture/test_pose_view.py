"""Poses over the sample: what stands where follows the capture, and keys do what the mouse does."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from PySide6.QtCore import QPoint, QPointF, Qt
from PySide6.QtGui import QImage, QPainter, QPalette
from PySide6.QtTest import QTest
from pytestqt.qtbot import QtBot

from gui.capture.pose_canvas import PoseCanvas
from gui.capture.pose_signs import COLOURS, SIGNS, draw_sign
from gui.capture.pose_view import PoseView
from gui.capture.poses import PoseState, SeenPoses
from protocols.capture.progress import PoseBegun
from tests.gui.told_poses import ToldCapture, planned

P, C, D, M = PoseState.PLANNED, PoseState.CURRENT, PoseState.COMPLETE, PoseState.MISSED


@pytest.fixture
def capture() -> ToldCapture:
    return ToldCapture()


@pytest.fixture
def poses(capture: ToldCapture) -> SeenPoses:
    return capture.seen()


@pytest.fixture
def view(poses: SeenPoses, qtbot: QtBot) -> PoseView:
    view = PoseView(poses)
    qtbot.addWidget(view)
    view.resize(400, 400)
    return view


def test_poses_are_planned_then_taken_then_complete(capture: ToldCapture, poses: SeenPoses):
    capture.planned.emit(SimpleNamespace(planned=planned()))
    assert poses.states == [P] * 5
    capture.tell(planned())
    capture.take(0)
    capture.tell(PoseBegun(1))
    assert poses.states == [D, C, P, P, P]
    assert poses.current == 1
    assert set(poses.previews) == {0}


def test_a_pose_that_was_not_finished_is_marked_when_the_capture_ends(capture: ToldCapture, poses: SeenPoses):
    capture.tell(planned())
    capture.take(0)
    capture.tell(PoseBegun(1))
    capture.released.emit()
    assert poses.states == [D, M, P, P, P]


def test_poses_of_an_earlier_run_are_complete_from_the_start(capture: ToldCapture, poses: SeenPoses):
    capture.tell(planned(complete=(0, 3)))
    assert poses.states == [D, P, P, D, P]
    assert poses.previews == {}


def test_a_new_plan_forgets_what_was_seen_before(capture: ToldCapture, poses: SeenPoses):
    capture.tell(planned())
    capture.take(0, 1)
    capture.tell(planned())
    assert (poses.states, poses.previews) == ([P] * 5, {})


def test_nothing_is_shown_before_there_are_poses(capture: ToldCapture, view: PoseView):
    assert view.isHidden()
    capture.tell(planned())
    assert not view.isHidden()


def test_the_pose_being_taken_is_named_and_all_are_counted(capture: ToldCapture, view: PoseView):
    capture.tell(planned())
    capture.take(0, 1)
    capture.tell(PoseBegun(2))
    assert view.name_label.text() == "pose 3 of 5: tilt 30 deg, turn 90 deg"
    assert view.count_label.text().split("   ") == ["○ 2 planned", "◆ 1 being taken", "● 2 complete"]


def test_page_down_and_a_click_name_other_poses(capture: ToldCapture, view: PoseView, qtbot: QtBot):
    capture.tell(planned())
    view.show()
    QTest.keyClick(view.canvas, Qt.Key.Key_PageDown)
    assert view.name_label.text().startswith("pose 1 of 5")
    QTest.keyClick(view.canvas, Qt.Key.Key_PageUp)
    assert view.name_label.text().startswith("pose 5 of 5")
    sides = planned().views.lens / 350.0
    x, y = view.canvas.at(sides[3])
    QTest.mouseClick(view.canvas, Qt.MouseButton.LeftButton, pos=QPoint(round(x), round(y)))
    assert view.name_label.text().startswith("pose 4 of 5")


@pytest.fixture
def canvas(qtbot: QtBot) -> PoseCanvas:
    canvas = PoseCanvas()
    qtbot.addWidget(canvas)
    canvas.resize(300, 300)
    return canvas


def test_from_above_x_is_right_and_y_is_up(canvas: PoseCanvas):
    canvas.turn_deg, canvas.height_deg = -90.0, 90.0
    centre, x, y = canvas.at(np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]))
    assert x[0] > centre[0] + 50
    assert x[1] == pytest.approx(centre[1])
    assert y[1] < centre[1] - 50
    assert y[0] == pytest.approx(centre[0])


@pytest.mark.parametrize("height_deg", [0.0, 30.0, 60.0, 90.0])
@pytest.mark.parametrize("size", [(300, 300), (120, 300), (400, 90)])
def test_the_whole_hemisphere_is_in_sight(canvas: PoseCanvas, height_deg: float, size: tuple[int, int]):
    canvas.resize(*size)
    canvas.height_deg = height_deg
    azimuth, tilt = np.meshgrid(np.linspace(0, 2 * np.pi, 40), np.linspace(0, np.pi / 2, 10))
    places = canvas.at(np.stack([np.sin(tilt) * np.cos(azimuth), np.sin(tilt) * np.sin(azimuth), np.cos(tilt)], -1))
    assert (places >= 0.0).all()
    assert (places <= size).all()


def test_arrow_keys_and_the_mouse_turn_it(canvas: PoseCanvas):
    before = (canvas.turn_deg, canvas.height_deg)
    QTest.keyClick(canvas, Qt.Key.Key_Right)
    QTest.keyClick(canvas, Qt.Key.Key_Up)
    assert (canvas.turn_deg, canvas.height_deg) == (before[0] + 10.0, before[1] + 10.0)
    near = np.array([np.cos(np.radians(canvas.turn_deg)), np.sin(np.radians(canvas.turn_deg)), 0.0])
    x = canvas.at(near)[0]
    QTest.mousePress(canvas, Qt.MouseButton.LeftButton, pos=QPoint(150, 150))
    QTest.mouseMove(canvas, QPoint(190, 150))
    # What is near goes with the mouse.
    assert canvas.at(near)[0] > x + 5
    for _ in range(30):
        QTest.keyClick(canvas, Qt.Key.Key_Down)
    assert canvas.height_deg == 0.0


def test_states_differ_by_shape_and_not_only_by_colour():
    shapes = {state: _shape(state) for state in PoseState}
    for a, b in combinations(PoseState, 2):
        assert np.mean(shapes[a] != shapes[b]) > 0.01
    assert len(set(COLOURS.values())) == len(set(SIGNS.values())) == len(PoseState)


def _shape(state: PoseState) -> np.ndarray:
    image = QImage(40, 40, QImage.Format.Format_Grayscale8)
    image.fill(0)
    painter = QPainter(image)
    draw_sign(painter, QPointF(20.0, 20.0), 10.0, state)
    painter.end()
    return np.array([[image.pixelColor(x, y).value() > 0 for x in range(40)] for y in range(40)])


def test_it_is_drawn_in_the_colours_of_the_window(canvas: PoseCanvas):
    for name in ("#102030", "#f0e0d0"):
        palette = QPalette(canvas.palette())
        palette.setColor(QPalette.ColorRole.Base, name)
        canvas.setPalette(palette)
        assert canvas.grab().toImage().pixelColor(1, 1).name() == name
