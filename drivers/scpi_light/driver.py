"""The driver `light.scpi`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.driver import Driver
from drivers.scpi_light.discovery import find_instruments
from drivers.scpi_light.light import ScpiLight
from drivers.scpi_light.settings import ScpiLightSettings


def _open(settings: ScpiLightSettings, table: Mapping[str, Any]) -> ScpiLight:
    return ScpiLight(settings, table.get("serial_number", ""))


DRIVER = Driver("light", ScpiLightSettings, _open, find_instruments)
