import sys
import time
from collections.abc import Callable, Iterator

import pytest

from drivers.contracts.light import LightContract
from drivers.light import Light
from drivers.supervised_light import SupervisedLight
from tests.drivers.lights.serial_light_double import SerialLightDouble


class TestSerialLight(LightContract):
    """Under its supervisor, which keeps its lease."""

    @pytest.fixture
    def light(self) -> Iterator[Light]:
        double = SerialLightDouble()
        light = SupervisedLight([sys.executable, "-m", "tests.drivers.lights.supervised_serial_light", double.port])
        yield light
        light.disconnect()
        double.unplug()

    @pytest.fixture
    def wait(self) -> Callable[[float], None]:
        return time.sleep

    @pytest.fixture
    def lease(self) -> float:
        return 5.0
