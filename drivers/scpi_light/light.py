"""A LED controller with the commands of Thorlabs' DC2200.

The lease is the controller's own: it shines in one pulse, or in a few with a microsecond between them, and stops by
itself when the last one has passed, whatever becomes of the computer and the cable.

References
----------
Thorlabs, DC2200 Operation Manual 1.8 (2023), section 4.3.2.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

from drivers.errors import DeviceError, UnsafeError
from drivers.lease import LEVEL_LIMITS
from drivers.light import LightDescription, LightState
from drivers.lights.led_light import DARK, LedLight
from drivers.scpi_light.dialogue import ScpiDialogue, ScpiSetting
from drivers.scpi_light.settings import ScpiLightSettings, UsbAddress
from drivers.scpi_light.transport import UsbTmc

CURRENT_LIMIT = ScpiSetting("the current limit", "SOURCE1:CURRENT:LIMIT", "A", 0.002)
TERMINAL = ScpiSetting("the terminal", "OUTPUT1:TERMINAL", "", 0.0)
BRIGHTNESS = ScpiSetting("the brightness", "SOURCE1:PULSE:BRIGHTNESS:LEVEL:AMPLITUDE", "% of the current limit", 0.1)
ON_TIME = ScpiSetting("the pulse's length", "SOURCE1:PULSE:ONTIME", "s", 0.001)
OFF_TIME = ScpiSetting("the pause between pulses", "SOURCE1:PULSE:OFFTIME", "s", 1e-6)
COUNT = ScpiSetting("the number of pulses", "SOURCE1:PULSE:COUNT", "", 0.0)

LONGEST_PULSE, SHORTEST_PAUSE = 10.0, 1e-6
"""Seconds that the controller takes."""

# What switches the LED off, whatever it is told, and what to do about it.
_PROTECTIONS = (
    ("OUTPUT1:PROTECTION:INTLOCK:TRIPPED?", "its interlock is open. Close it"),
    ("OUTPUT1:PROTECTION:TEMPERATURE:DRIVER:TRIPPED?", "it is too hot. Let it cool and look at its fan"),
    ("OUTPUT1:PROTECTION:TEMPERATURE:HEAD:TRIPPED?", "its LED head is too hot. Let it cool and look at its heat sink"),
    ("SOURCE1:CURRENT:LIMIT:TRIPPED?", "its current limit tripped. Look at the LED and its cable"),
)


class ScpiLight(LedLight):
    """One output of a LED controller.

    Parameters
    ----------
    settings : ScpiLightSettings
    serial_number : str
        Of the one controller allowed; empty = the only one that is plugged in.
    backend : usb.backend.IBackend, optional
        None = libusb.
    """

    _ends_by_itself = True

    def __init__(self, settings: ScpiLightSettings, serial_number: str = "", backend: Any = None) -> None:
        super().__init__(settings.longest_lease_s)
        self._settings = settings
        self._address = UsbAddress(settings.vendor_id, settings.product_id, serial_number)
        self._transport = UsbTmc(self._address, settings.answer_time_s, backend)
        self._dialogue = ScpiDialogue(self._transport)

    @property
    def _is_open(self) -> bool:
        return self._transport.is_open

    @property
    def _name(self) -> str:
        return self.describe().serial_number

    def _open(self) -> None:
        self._transport.open()

    def _close(self) -> None:
        self._transport.close()

    def _prepared(self, description: LightDescription) -> LightDescription:
        # What went wrong before is not of this session.
        self._dialogue.command("*CLS")
        self._dialogue.ensure(TERMINAL, self._settings.terminal)
        self._dialogue.ensure(CURRENT_LIMIT, self._settings.max_current_a)
        held = tuple(self._dialogue.read_back(setting) for setting in (CURRENT_LIMIT, TERMINAL))
        return replace(description, settings=held)

    def _identified(self) -> LightDescription:
        identity = self._dialogue.ask("*IDN?")
        make, model, serial_number, firmware = [*identity.split(","), "", "", ""][:4]
        if self._settings.model not in model:
            raise DeviceError(
                f"the USB device {self._address} is {identity!r}; expected was a {self._settings.model}. "
                "Look at the rig file's [light.device]"
            )
        return LightDescription(make.strip(), model.strip(), serial_number.strip(), LEVEL_LIMITS, firmware.strip())

    def _shine(self, level: float, max_seconds: float) -> LightState:
        self._switch_off()
        if level == 0.0:
            return self._state()
        self._check_protections()
        self._set_pulses(level, max_seconds)
        self._will_shine(max_seconds)
        self._dialogue.command("OUTPUT1:STATE ON")
        self._dialogue.check_errors("to switch on")
        state = self._state()
        if not state.lit:
            self._check_protections()
        return state

    def _set_pulses(self, level: float, max_seconds: float) -> None:
        n_pulses = math.ceil(max_seconds / LONGEST_PULSE)
        self._dialogue.command("SOURCE1:MODE PULS")
        self._dialogue.check_errors("its pulse mode")
        # Somebody may have changed it on the controller's own panel.
        self._dialogue.ensure(CURRENT_LIMIT, self._settings.max_current_a)
        self._dialogue.set_verified(BRIGHTNESS, 100.0 * level)
        self._dialogue.set_verified(ON_TIME, max_seconds / n_pulses)
        self._dialogue.set_verified(OFF_TIME, SHORTEST_PAUSE)
        self._dialogue.set_verified(COUNT, n_pulses)

    def _switch_off(self) -> None:
        self._dialogue.command("OUTPUT1:STATE OFF")

    def _state(self) -> LightState:
        if not self._dialogue.flag("OUTPUT1:STATE?"):
            return DARK
        return LightState(True, self._dialogue.number(f"{BRIGHTNESS.header}?") / 100.0, math.nan, math.nan)

    def _check_protections(self) -> None:
        tripped = [remedy for question, remedy in _PROTECTIONS if self._dialogue.flag(question)]
        if tripped:
            raise UnsafeError(f"the light {self._name} does not shine: {'; '.join(tripped)}")
