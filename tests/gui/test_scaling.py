"""The window on screens whose desktop is scaled: a process each, since Qt reads the factor when it starts."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FULL_HD = (1920, 1040)
"""Dots, less what a desktop keeps for itself."""

PROGRAM = """
import json, sys
from PySide6.QtCore import QEventLoop, QTimer
from PySide6.QtWidgets import QAbstractButton, QApplication, QLabel
from gui.main_window import MainWindow
from tests.gui.test_main_window import Bench, rig_config

width, height = map(int, sys.argv[1:])
application = QApplication([])
window = MainWindow(rig_config(), Bench().devices)
window.resize(width, height)
window.show()
for _ in range(200):
    loop = QEventLoop()
    QTimer.singleShot(50, loop.quit)
    loop.exec()
    if window.controls.live_button.isEnabled():
        break
cut = []
for i_tab in range(window.tabs.count()):
    window.tabs.setCurrentIndex(i_tab)
    application.processEvents()
    cut += [
        widget.text()
        for kind in (QAbstractButton, QLabel)
        for widget in window.findChildren(kind)
        if widget.isVisible() and widget.text() and widget.width() < widget.minimumSizeHint().width()
    ]
picture = window.grab()
print(json.dumps({
    "ratio": window.devicePixelRatioF(),
    "size": [window.width(), window.height()],
    "dots": [picture.width(), picture.height()],
    "cut": cut,
}))
window.close()
"""


@pytest.mark.parametrize("factor", [1.25, 2.0])
def test_the_window_fits_a_full_hd_screen_with_every_text_whole(factor: float):
    size = [int(n / factor) for n in FULL_HD]
    environment = {**os.environ, "QT_QPA_PLATFORM": "offscreen", "QT_SCALE_FACTOR": str(factor)}
    command = [sys.executable, "-c", PROGRAM, *map(str, size)]
    done = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    told = json.loads(done.stdout)
    assert told["ratio"] == factor
    assert told["size"] == size
    assert told["dots"] == [pytest.approx(n, abs=2) for n in FULL_HD]
    assert told["cut"] == []
