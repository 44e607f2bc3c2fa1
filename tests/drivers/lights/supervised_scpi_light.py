"""The supervisor of a LED controller on a bus that is a double; FLAG, where given, is set on the controller."""

import sys

from drivers.light_supervisor import supervise
from drivers.scpi_light.light import ScpiLight
from drivers.scpi_light.settings import ScpiLightSettings
from tests.drivers.lights.dc2200_double import Dc2200Double
from tests.drivers.lights.usbtmc_double import UsbBus, UsbTmcDevice

if __name__ == "__main__":
    controller = Dc2200Double()
    for flag in sys.argv[1:]:
        setattr(controller, flag, True)
    light = ScpiLight(ScpiLightSettings(max_current_a=1.0), "", UsbBus(UsbTmcDevice(controller)))
    sys.exit(supervise(light, sys.stdin.fileno(), sys.stdout.fileno()))
