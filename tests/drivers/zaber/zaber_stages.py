"""The stage that the tests of the Zaber driver hang on its double."""

from __future__ import annotations

from typing import Any

import pytest

from drivers.device_settings import settings_from_table
from drivers.zaber.settings import ZaberSettings
from tests.drivers.zaber.zaber_double import ZaberDouble

# Tilt turns against its device; turn is the second axis of the second one.
TILT = {
    "name": "tilt",
    "device_address": 1,
    "kind": "rotation",
    "vector": [1.0, 0.0, 0.0],
    "soft_limits": [-65.0, 65.0],
    "tolerance": 0.01,
    "scale": -1000.0,
    "zero": 20_000.0,
}
TURN = {
    "name": "turn",
    "device_address": 2,
    "axis_number": 2,
    "kind": "rotation",
    "vector": [0.0, 0.0, 1.0],
    "soft_limits": [-180.0, 180.0],
    "tolerance": 0.02,
    "scale": 500.0,
}


def settings_of(double: ZaberDouble, **changes: Any) -> ZaberSettings:
    table = {"port": double.port, "axes": [TILT, TURN], "settling_time_s": 0.01, **changes}
    return settings_from_table(ZaberSettings, table)


def skip_without_zaber() -> None:
    """Skip, visibly, where the library is not installed."""
    reason = 'zaber-motion is not installed: pip install "halfangle[zaber]"'
    pytest.importorskip("zaber_motion", reason=reason, exc_type=ImportError)
