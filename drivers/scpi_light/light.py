"""A LED controller with the commands of Thorlabs' DC2200.

The lease is the controller's own: it shines in one pulse, or in a few with a microsecond between them, and stops by
itself when the last one has passed, whatever becomes of the computer and the cable.

References
----------
Thorlabs, DC2200 Operation Manual 1.8 (2023), section 4.3.2.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from typing import Any

from drivers.errors import DeviceError, UnsafeError
from drivers.lease import LEVEL_LIMITS, check_lease, check_level
from drivers.light import LightDescription, LightState
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
_DARK = LightState(lit=False, level=0.0, monitor=math.nan, temperature=math.nan)


class ScpiLight:
    """One output of a LED controller.

    Parameters
    ----------
    settings : ScpiLightSettings
    serial_number : str
        Of the one controller allowed; empty = the only one that is plugged in.
    backend : usb.backend.IBackend, optional
        None = libusb.
    """

    def __init__(self, settings: ScpiLightSettings, serial_number: str = "", backend: Any = None) -> None:
        self._settings = settings
        self._address = UsbAddress(settings.vendor_id, settings.product_id, serial_number)
        self._transport = UsbTmc(self._address, settings.answer_time_s, backend)
        self._dialogue = ScpiDialogue(self._transport)
        self._description: LightDescription | None = None

    def connect(self) -> None:
        """Open the controller, dark, with the current limit of the settings; safe to call twice.

        Raises
        ------
        DeviceError
            If it is not there, not allowed, busy or another device, or holds another limit; then nothing stays open.
        """
        if self._description is not None and self._transport.is_open:
            return
        self._transport.open()
        try:
            self._description = self._identified()
            self._start_dark()
            self._dialogue.ensure(TERMINAL, self._settings.terminal)
            self._dialogue.ensure(CURRENT_LIMIT, self._settings.max_current_a)
            held = tuple(self._dialogue.read_back(setting) for setting in (CURRENT_LIMIT, TERMINAL))
            self._description = replace(self._description, settings=held)
        except BaseException:
            self._forget()
            raise

    def disconnect(self) -> None:
        """Switch off and close; safe to call twice, and without `connect`."""
        try:
            self.off()
        finally:
            self._forget()

    def describe(self) -> LightDescription:
        """Return what the controller says that it is."""
        return self._connected()

    def on(self, level: float, max_seconds: float) -> LightState:
        """Shine at `level` for at most `max_seconds`, then go dark unless told again.

        Raises
        ------
        DeviceLimitError
            If `level` is outside the limits, or `max_seconds` not positive, or longer than the settings allow.
        UnsafeError
            If the controller protects itself or its user: names why.
        """
        self._connected()
        check_level(level)
        check_lease(max_seconds, self._settings.longest_lease_s)
        try:
            return self._shine(level, max_seconds)
        except BaseException:
            # What went wrong first is the message; the pulse ends by itself if this fails too.
            with suppress(DeviceError):
                self._switch_off()
            raise

    def off(self) -> LightState:
        """Go dark and confirm it by read-back; safe to call at any time."""
        if self._description is None:
            return _DARK
        self._switch_off()
        return self._state()

    def read(self) -> LightState:
        """Return the state as the controller reports it."""
        self._connected()
        return self._state()

    def _start_dark(self) -> None:
        if self.off().lit:
            raise UnsafeError(f"the light {self._connected().serial_number} does not go off. Switch it off by hand")
        # What went wrong before is not of this session.
        self._dialogue.command("*CLS")

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
            return _DARK
        return LightState(True, self._dialogue.number(f"{BRIGHTNESS.header}?") / 100.0, math.nan, math.nan)

    def _check_protections(self) -> None:
        tripped = [remedy for question, remedy in _PROTECTIONS if self._dialogue.flag(question)]
        if tripped:
            raise UnsafeError(f"the light {self._connected().serial_number} does not shine: {'; '.join(tripped)}")

    def _connected(self) -> LightDescription:
        if self._description is None:
            raise DeviceError("the light is not connected. Call connect() first.")
        return self._description

    def _forget(self) -> None:
        self._description = None
        self._transport.close()
