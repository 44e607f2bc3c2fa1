"""Open the three simulated devices of one rig."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.clock import Clock
from drivers.simulated.camera import SimulatedCamera
from drivers.simulated.light import SimulatedLight
from drivers.simulated.stage import SimulatedStage
from drivers.simulated.world import World


def open_simulated(
    rig: Mapping[str, Any], clock: Clock | None = None
) -> tuple[World, SimulatedCamera, SimulatedLight, SimulatedStage]:
    """Return a world and its devices, not yet connected.

    Parameters
    ----------
    rig : mapping
        A parsed rig.toml.
    clock : Clock, optional
        Virtual by default: motions and exposures take no time of yours.
    """
    world = World.from_rig(rig, clock)
    return world, SimulatedCamera(world), SimulatedLight(world), SimulatedStage(world)
