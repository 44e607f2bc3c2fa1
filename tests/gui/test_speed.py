"""The window stays alive: bounds far from what `python -m benchmarks.speed.console` measures on a machine at rest."""

import time
from collections.abc import Iterator

import pytest
from pytestqt.qtbot import QtBot

from benchmarks.speed.console import large_rig, measure_live, opening_seconds, ready_devices, switch_everything_on
from benchmarks.speed.watchdog import Watchdog
from gui.main_window import MainWindow

SLOWEST, MAX_BLOCK, MAX_OPENING = 15.0, 0.25, 6.0
"""Updates a second, seconds, seconds: half, five times and three times what is asked for."""


@pytest.fixture
def live(qtbot: QtBot) -> Iterator[MainWindow]:
    window = MainWindow(large_rig(), ready_devices)
    window.resize(1600, 1000)
    window.show()
    switch_everything_on(window)
    qtbot.waitUntil(window.controls.live_button.isEnabled, timeout=30_000)
    window.controls.live_button.click()
    qtbot.waitUntil(lambda: window.live_view.boards.found.data.size > 0, timeout=60_000)
    yield window
    window.close()
    window.deleteLater()


@pytest.mark.slow
@pytest.mark.alone
def test_large_live_frames_with_all_overlays_leave_the_window_alive(live: MainWindow, qtbot: QtBot):
    qtbot.wait(1000)
    speed = measure_live(live, 5.0)
    assert speed.updates > SLOWEST
    assert speed.longest_block < MAX_BLOCK


@pytest.mark.slow
@pytest.mark.alone
def test_the_window_opens_soon():
    assert opening_seconds() < MAX_OPENING


def test_the_watchdog_sees_a_thread_that_is_blocked(qtbot: QtBot):
    watchdog = Watchdog()
    watchdog.begin()
    qtbot.wait(50)
    time.sleep(0.2)
    qtbot.wait(50)
    watchdog.end()
    assert 0.15 < watchdog.longest < 1.0
