from collections.abc import Callable

import pytest

from drivers.camera import Camera
from drivers.contracts.camera import CameraContract
from drivers.contracts.light import LightContract
from drivers.contracts.stage import StageContract
from drivers.light import Light
from drivers.simulated.camera import SimulatedCamera
from drivers.simulated.light import SimulatedLight
from drivers.simulated.stage import SimulatedStage
from drivers.simulated.world import World
from drivers.stage import Stage
from tests.drivers.rigs import small_rig


@pytest.fixture
def world() -> World:
    return World.from_rig(small_rig(scene="plane"))


class TestSimulatedCamera(CameraContract):
    @pytest.fixture
    def camera(self, world: World) -> Camera:
        return SimulatedCamera(world)


class TestSimulatedLight(LightContract):
    @pytest.fixture
    def light(self, world: World) -> Light:
        return SimulatedLight(world)

    @pytest.fixture
    def wait(self, world: World) -> Callable[[float], None]:
        return world.clock.sleep


class TestSimulatedStage(StageContract):
    @pytest.fixture
    def stage(self, world: World) -> Stage:
        return SimulatedStage(world)

    @pytest.fixture
    def now(self, world: World) -> Callable[[], float]:
        return world.clock.now
