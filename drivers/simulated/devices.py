"""Open the three simulated devices of one rig."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.clock import Clock, RealClock
from drivers.simulated.camera import SimulatedCamera
from drivers.simulated.faults import Fault, FaultScript, FaultyCamera, FaultyLight, FaultyStage
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
    world.compile()
    return world, SimulatedCamera(world), SimulatedLight(world), SimulatedStage(world)


def open_faulty(
    rig: Mapping[str, Any], faults: tuple[Fault, ...], clock: Clock | None = None
) -> tuple[World, FaultyCamera, FaultyLight, FaultyStage]:
    """Return a world and devices that follow a script of `faults`; else as `open_simulated`."""
    world, camera, light, stage = open_simulated(rig, clock)
    scripts = {kind: FaultScript(kind, faults, world) for kind in ("camera", "light", "stage")}
    return (
        world,
        FaultyCamera(camera, scripts["camera"]),
        FaultyLight(light, scripts["light"]),
        FaultyStage(stage, scripts["stage"]),
    )


def open_lone_light(rig: Mapping[str, Any]) -> SimulatedLight:
    """Return a light that shines on a world of its own in real time, as the process of a supervisor has it."""
    return SimulatedLight(World.from_rig(rig, RealClock()))
