"""What the tests of the window share."""

from __future__ import annotations

import pytest

HANG_MS = 120_000
"""A wait for the window that takes so long has hung; pytest-qt's own 5 s are over on a busy computer."""

try:
    from pytestqt.qtbot import QtBot
except ImportError:  # the tests of the window are left out
    pass
else:

    @pytest.fixture(autouse=True, scope="session")
    def _patience() -> None:
        for wait in (QtBot.waitUntil, QtBot.waitSignal, QtBot.waitSignals, QtBot.waitExposed, QtBot.waitActive):
            defaults = wait.__kwdefaults__ or {}
            if "timeout" in defaults:
                defaults["timeout"] = HANG_MS
