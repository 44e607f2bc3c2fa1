"""The driver `camera.genicam`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.driver import Driver
from drivers.genicam.camera import GenicamCamera
from drivers.genicam.discovery import find_cameras
from drivers.genicam.settings import GenicamSettings


def open_genicam(settings: GenicamSettings, table: Mapping[str, Any]) -> GenicamCamera:
    """Return the camera of the table `[camera]`, not yet connected."""
    return GenicamCamera(settings, table.get("serial_number") or None, table["width"], table["height"])


DRIVER = Driver("camera", GenicamSettings, open_genicam, find_cameras)
