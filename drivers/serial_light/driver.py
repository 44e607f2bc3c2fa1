"""The driver `light.serial`."""

from __future__ import annotations

from drivers.driver import Driver
from drivers.serial_light.light import SerialLight
from drivers.serial_light.settings import SerialLightSettings

DRIVER = Driver("light", SerialLightSettings, lambda settings, _: SerialLight(settings))
