"""What Qt's bindings must not do to a program that runs for days."""

import sys

from PySide6.QtWidgets import QPushButton
from pytestqt.qtbot import QtBot

N_CALLS = 2000


def test_calls_into_qt_take_no_references_from_none_and_true(qtbot: QtBot):
    """See docs/decisions/0020."""
    button = QPushButton()
    qtbot.addWidget(button)
    before = [sys.getrefcount(value) for value in (None, True, False)]
    for i in range(N_CALLS):
        button.setEnabled(i % 2 == 0)
        button.isEnabled()
    lost = [n - sys.getrefcount(value) for n, value in zip(before, (None, True, False), strict=True)]
    assert max(lost) < N_CALLS // 10
