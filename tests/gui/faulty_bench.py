"""Simulated devices for a window that lives on them and captures with them in turn."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from drivers.clock import RealClock
from drivers.registry import Devices
from drivers.simulated.camera import SimulatedCamera
from drivers.simulated.clock import VirtualClock
from drivers.simulated.devices import open_faulty
from drivers.simulated.faults import Fault
from drivers.simulated.world import World


class FaultyBench:
    """Makes sound devices for the live picture, and such with faults for what comes between two of them."""

    def __init__(self, *faults: Fault) -> None:
        self.faults = faults
        self.camera: type[SimulatedCamera] | None = None
        self.worlds: list[World] = []

    def devices(self, rig: Mapping[str, Any]) -> Devices:
        is_live = len(self.worlds) % 2 == 0
        clock = VirtualClock() if self.worlds else RealClock()
        world, camera, light, stage = open_faulty(rig, () if is_live else self.faults, clock)
        self.worlds.append(world)
        return Devices(self.camera(world) if self.camera else camera, light, stage, world.clock)

    @property
    def lit(self) -> bool:
        return any(world.lamp.level > 0.0 for world in self.worlds)
