"""The simulated rig of the examples, and what it knows of its sample."""

from __future__ import annotations

from pathlib import Path

from analysis.registration.grid import Grid
from analysis.registration.stack import Truth
from drivers.simulated.world import World
from instrument.config.rig import RigConfig

EXAMPLES = Path(__file__).parents[2] / "examples"


def truth_of(rig: RigConfig, grid: Grid) -> Truth:
    """Return what the simulation knows of the sample, to score with; nothing in the analysis reads it to fit."""
    points = grid.points()
    truth = World.from_rig(rig.model_dump(exclude_none=True)).truth(points[..., 0], points[..., 1])
    return Truth(truth.normals, truth.depth - truth.depth.mean(), truth.material)
