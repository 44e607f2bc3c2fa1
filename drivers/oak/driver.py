"""The driver `camera.oak`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.driver import Driver
from drivers.oak.camera import OakCamera
from drivers.oak.finding import find_oak
from drivers.oak.settings import OakSettings


def open_oak(settings: OakSettings, table: Mapping[str, Any]) -> OakCamera:
    """Return the camera, not yet connected."""
    return OakCamera(settings, table.get("serial_number") or None, int(table["height"]), int(table["width"]))


DRIVER = Driver("camera", OakSettings, open_oak, find_oak)
