"""A supervisor whose simulated light writes down when it shines: RECORD is a file, a line each time it changes."""

import sys
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from drivers.clock import RealClock
from drivers.light import LightState
from drivers.light_supervisor import supervise
from drivers.simulated.lamp import Lamp
from drivers.simulated.light import SimulatedLight


class RecordedLight(SimulatedLight):
    def on(self, level: float, max_seconds: float) -> LightState:
        state = super().on(level, max_seconds)
        write("on")
        return state

    def off(self) -> LightState:
        state = super().off()
        write("off")
        return state


def write(word: str) -> None:
    with Path(sys.argv[1]).open("a") as file:
        file.write(f"{word} {time.time()}\n")


def lone_world() -> Any:
    """A lamp and no scene: whoever supervises a light sees no more of the world."""
    simulation = SimpleNamespace(seed=5)
    return SimpleNamespace(lamp=Lamp(RealClock(), 0.0, 1.0), bench=SimpleNamespace(simulation=simulation))


if __name__ == "__main__":
    sys.exit(supervise(RecordedLight(lone_world()), sys.stdin.fileno(), sys.stdout.fileno()))
