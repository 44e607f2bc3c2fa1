"""What all tests share."""

from __future__ import annotations

import os
import tempfile

# Windows are never shown, whoever calls pytest; set before Qt is imported.
os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

pytest_plugins = ["tests.page_plugin", "tests.faults.record"]

# Rigs of the tests are nobody else's: two runs on one machine must not refuse each other's.
os.environ["HALFANGLE_LOCK_FOLDER"] = tempfile.mkdtemp(prefix="halfangle-locks-")
