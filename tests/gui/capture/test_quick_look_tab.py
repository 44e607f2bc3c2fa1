"""What the operator sees of the poses so far."""

from collections.abc import Iterator

import numpy as np
import pytest
from pytestqt.qtbot import QtBot

from gui.capture.quick_look_tab import QuickLookTab
from protocols.poses.patterns import ring
from tests.gui.told_poses import ToldCapture, planned

POSES = (*ring(0.0, 1), *ring(20.0, 3), *ring(40.0, 4, 10.0))


@pytest.fixture
def capture() -> ToldCapture:
    return ToldCapture()


@pytest.fixture
def tab(capture: ToldCapture, qtbot: QtBot) -> Iterator[QuickLookTab]:
    tab = QuickLookTab(capture.seen())
    qtbot.addWidget(tab)
    tab.failed.connect(pytest.fail)
    yield tab
    tab.close_worker()


def wait_for(text: str, tab: QuickLookTab, qtbot: QtBot) -> None:
    qtbot.waitUntil(lambda: text in tab.text_label.text(), timeout=120_000)


def test_normals_coverage_and_the_next_pose_come_while_poses_come(
    capture: ToldCapture, tab: QuickLookTab, qtbot: QtBot
):
    tab.show()
    capture.tell(planned(*POSES))
    capture.take(0, 1)
    wait_for("no normals yet: 2 views; at least 4 are needed", tab, qtbot)
    capture.take(*range(2, 8))
    wait_for("poses looked at: 8", tab, qtbot)
    assert "deg by the scatter of the views; nominal places add" in tab.text_label.text()
    assert "one more pose would help most at tilt" in tab.text_label.text()
    assert tab.picture.size_in_pixels[1] == 64
    assert np.any(tab.bars.opts["height"])


def test_nothing_is_computed_while_nobody_looks_and_all_of_it_once_somebody_does(
    capture: ToldCapture, tab: QuickLookTab, qtbot: QtBot
):
    capture.tell(planned(*POSES))
    capture.take(*range(5))
    qtbot.wait(50)
    assert not tab.is_working
    tab.show()
    wait_for("poses looked at: 5", tab, qtbot)
