"""The driver `stage.grbl`."""

from __future__ import annotations

from drivers.driver import Driver
from drivers.grbl.settings import GrblSettings
from drivers.grbl.stage import GrblStage

DRIVER = Driver("stage", GrblSettings, lambda settings, _: GrblStage(settings))
