"""The stage that the tests of the GRBL driver hang on its double."""

from __future__ import annotations

from typing import Any

from drivers.grbl.settings import GrblAxis, GrblSettings
from tests.drivers.grbl.grbl_double import GrblDouble

# The travel of the double is -200 to 0 in machine units; tilt turns against its letter.
TILT = GrblAxis(
    name="tilt",
    letter="Y",
    kind="rotation",
    vector=(1.0, 0.0, 0.0),
    soft_limits=(-65.0, 65.0),
    tolerance=0.02,
    scale=-1.0,
    zero=-100.0,
)
TURN = GrblAxis(
    name="turn",
    letter="X",
    kind="rotation",
    vector=(0.0, 0.0, 1.0),
    soft_limits=(-180.0, 180.0),
    tolerance=0.05,
    scale=0.5,
    zero=-100.0,
)


def settings_of(double: GrblDouble, **changes: Any) -> GrblSettings:
    return GrblSettings(**{"port": double.port, "axes": (TILT, TURN), "settling_time_s": 0.1, **changes})
