from collections.abc import Callable

import pytest

from drivers.contracts.light import LightContract
from drivers.light import Light
from drivers.scpi_light.light import ScpiLight
from drivers.scpi_light.settings import ScpiLightSettings
from drivers.simulated.clock import VirtualClock
from tests.drivers.lights.dc2200_double import Dc2200Double
from tests.drivers.lights.usbtmc_double import UsbBus, UsbTmcDevice


class TestScpiLight(LightContract):
    @pytest.fixture
    def clock(self) -> VirtualClock:
        return VirtualClock()

    @pytest.fixture
    def light(self, clock: VirtualClock) -> Light:
        bus = UsbBus(UsbTmcDevice(Dc2200Double(clock.now)))
        return ScpiLight(ScpiLightSettings(max_current_a=1.0), "", bus)

    @pytest.fixture
    def wait(self, clock: VirtualClock) -> Callable[[float], None]:
        return clock.sleep
