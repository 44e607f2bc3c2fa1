"""A small capture of the simulated relief, for what is looked at while it runs, with the truth to score by."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.quick_look.views import quick_grid
from drivers.simulated.world import World
from instrument.config.rig import RigConfig

RIG = """
name = "small bench"
camera = { driver = "simulated", width = 192, height = 192, focal_length_px = 420.0 }
light = { driver = "simulated", offset_mm = [12.0, 0.0, 0.0], offset_sigma_mm = 3.0 }
stage = { driver = "simulated" }
geometry = { working_distance_mm = 350.0, area_mm = [60.0, 60.0] }
simulation = { seed = 7, warm_up_drift = 0.0, distortion = [-0.08, 0.05], light_offset_mm = [12.6, -1.1, 0.4] }
"""
PROTOCOL = """
name = "small sweep"
bracket = { exposure_times_s = [0.002, 0.01, 0.05], darks = 2 }
rings = [
    { tilt_deg = 0.0, count = 1 },
    { tilt_deg = 15.0, count = 6 },
    { tilt_deg = 30.0, count = 7, start_deg = 10.0 },
    { tilt_deg = 45.0, count = 6, start_deg = 5.0 },
]
"""


def write_files(folder: Path) -> tuple[Path, Path]:
    """Write rig and protocol; return where."""
    paths = folder / "rig.toml", folder / "protocol.toml"
    for path, text in zip(paths, (RIG, PROTOCOL), strict=True):
        path.write_text(text)
    return paths


def true_normals(rig: RigConfig) -> NDArray[np.float64]:
    """Return the normals of the simulated sample on the cells of a quick look."""
    points = quick_grid(rig.geometry.area_mm).points()
    return World.from_rig(rig.model_dump(exclude_none=True)).truth(points[..., 0], points[..., 1]).normals
