"""The supervisor of a serial light, as the rig would start it: PORT is the name of its port."""

import sys

from drivers.light_supervisor import supervise
from drivers.serial_light.light import SerialLight
from drivers.serial_light.settings import SerialLightSettings

if __name__ == "__main__":
    light = SerialLight(SerialLightSettings(port=sys.argv[1], identity="blinker", answer_time_s=1.0))
    sys.exit(supervise(light, sys.stdin.fileno(), sys.stdout.fileno()))
