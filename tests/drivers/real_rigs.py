"""The text of rig files with real drivers, table by table."""

from __future__ import annotations

GRBL = """[stage]
driver = "grbl"

[stage.device]
port = "/dev/ttyACM0"

[[stage.device.axes]]
name = "tilt"
letter = "Y"
kind = "rotation"
vector = [1.0, 0.0, 0.0]
soft_limits = [-65.0, 65.0]
tolerance = 0.02
"""
SCPI = """[light]
driver = "scpi"
offset_mm = [12.0, 0.0, 0.0]
offset_sigma_mm = 3.0

[light.device]
max_current_a = 1.0
"""
SERIAL = """[light]
driver = "serial"
offset_mm = [12.0, 0.0, 0.0]
offset_sigma_mm = 3.0

[light.device]
port = "/dev/ttyUSB0"
identity = "blinker"
"""
GENICAM = """[camera]
driver = "genicam"
width = 512
height = 512
focal_length_px = 1850.0
"""
HEAD = """name = "real rig"

[geometry]
working_distance_mm = 350.0
area_mm = [60.0, 60.0]

"""


def rig_text(camera: str = GENICAM, light: str = SCPI, stage: str = GRBL) -> str:
    """Return a rig file of three tables and the geometry."""
    return f"{HEAD}{camera}\n{light}\n{stage}"
