"""What all tests share."""

from __future__ import annotations

import os

# Windows are never shown, whoever calls pytest; set before Qt is imported.
os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest_plugins = ["tests.checks.plugin"]
