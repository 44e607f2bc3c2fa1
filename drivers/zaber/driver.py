"""The driver `stage.zaber`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.driver import Driver
from drivers.zaber.settings import ZaberSettings
from drivers.zaber.stage import ZaberStage


def open_zaber(settings: ZaberSettings, _table: Mapping[str, Any]) -> ZaberStage:
    """Return the stage, not yet connected."""
    return ZaberStage(settings)


# Nothing is found: a chain shows itself only to who opens its port and writes to it.
DRIVER = Driver("stage", ZaberSettings, open_zaber)
