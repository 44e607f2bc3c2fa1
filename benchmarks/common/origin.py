"""Where figures come from: day, machine and versions, kept beside them."""

from __future__ import annotations

import os
import platform
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

_PACKAGES = ("halfangle", "numpy", "scipy", "numba", "matplotlib")


def origin() -> dict[str, Any]:
    """Return day, machine and versions of packages."""
    versions = {name: version(name) for name in _PACKAGES}
    return {"day": time.strftime("%Y-%m-%d"), "machine": machine(), "versions": versions}


def machine() -> dict[str, Any]:
    """Return what the figures were taken on."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {"cpu": cpu_model(), "cores": cores, "system": platform.system(), "python": platform.python_version()}


def cpu_model(info: Path = Path("/proc/cpuinfo")) -> str:
    """Return the processor's name, where the system tells it."""
    if info.is_file():
        for text in info.read_text(encoding="utf-8").splitlines():
            name, _, value = text.partition(":")
            if name.strip() == "model name":
                return value.strip()
    return platform.processor() or platform.machine()
