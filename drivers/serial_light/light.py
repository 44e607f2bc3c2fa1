"""A LED driver on a serial port.

It has no time limit of its own: its lease is kept by `drivers.light_supervisor`, the process that owns its port.
"""

from __future__ import annotations

import math
import re
import time
from contextlib import suppress

from drivers.errors import DeviceError, DeviceLostError
from drivers.lease import LEVEL_LIMITS
from drivers.light import LightDescription, LightState
from drivers.lights.led_light import DARK, LedLight
from drivers.serial_light.dialogue import QUIET_TIME, LineDialogue
from drivers.serial_light.settings import SerialLightSettings
from drivers.serial_link.port import SerialPort, usb_serial_number

_TINY, _MOST_ROUNDING = 1e-9, 0.005  # of levels; an answer in whole percent is coarse enough


class SerialLight(LedLight):
    """A LED driver that answers each line with a line; shines until it is told to stop.

    Parameters
    ----------
    settings : SerialLightSettings
    """

    def __init__(self, settings: SerialLightSettings) -> None:
        super().__init__(settings.longest_lease_s)
        self._settings = settings
        self._port: SerialPort | None = None
        self._dialogue: LineDialogue | None = None

    @property
    def _is_open(self) -> bool:
        return self._port is not None

    @property
    def _name(self) -> str:
        return f"at {self._settings.port}"

    def _open(self) -> None:
        self._port = SerialPort(self._settings.port, self._settings.baud_rate, QUIET_TIME)
        self._dialogue = LineDialogue(self._port, self._settings.answer_time_s)
        time.sleep(self._settings.boot_time_s)

    def _identified(self) -> LightDescription:
        settings = self._settings
        identity = self._ask(settings.identify_command)
        if settings.identity not in identity:
            raise DeviceError(
                f"the device at {settings.port} answers {settings.identify_command!r} with {identity!r}; expected was "
                f"something with {settings.identity!r}. Look at port and identity in the rig file's [light.device]"
            )
        # A driver without a USB plug of its own has no number but its name.
        return LightDescription("", identity, usb_serial_number(settings.port) or identity, LEVEL_LIMITS)

    def _switch_off(self) -> None:
        self._command(self._settings.off_command)

    def _shine(self, level: float, max_seconds: float) -> LightState:
        # After `max_seconds` the supervisor switches off.
        if level == 0.0:
            return self.off()
        self._command(self._settings.level_line(level))
        self._will_shine(max_seconds)
        self._command(self._settings.on_command)
        state, step = self._state_and_step()
        sent = self._settings.sent_level(level)
        rounding = min(0.5 * step, _MOST_ROUNDING * self._settings.full_level)
        allowed = (self._settings.level_tolerance + rounding) / self._settings.full_level
        if state.lit and not math.isclose(state.level, sent, rel_tol=0.0, abs_tol=allowed + _TINY):
            raise DeviceError(
                f"the light at {self._settings.port} was set to level {sent:g} and reads back {state.level:g}; "
                f"allowed is a difference of {allowed:g}. Look at full_level in the rig file's [light.device]"
            )
        return state

    def _state(self) -> LightState:
        return self._state_and_step()[0]

    def _state_and_step(self) -> tuple[LightState, float]:
        """Return the state, and one step of the last digit that the answer has, counted like `full_level`."""
        question, expected = self._settings.state_command, self._settings.state
        answer = self._ask(question)
        match = re.fullmatch(expected, answer)
        if match is None:
            raise self._senseless(question, answer, f"a line that matches {expected}")
        if match["lit"] is None:
            return DARK, 0.0
        try:
            level = float(match["level"]) / self._settings.full_level
        except ValueError:
            raise self._senseless(question, answer, "a number for the level") from None
        return LightState(True, level, math.nan, math.nan), 10.0 ** -len(match["level"].partition(".")[2])

    def _command(self, line: str) -> None:
        answer = self._ask(line)
        if answer != self._settings.done:
            raise self._senseless(line, answer, repr(self._settings.done))

    def _ask(self, line: str) -> str:
        if self._dialogue is None:
            raise DeviceLostError(f"the light at {self._settings.port} is gone. Connect it again")
        try:
            return self._dialogue.ask(line)
        except DeviceLostError:
            self._close()
            raise

    def _senseless(self, line: str, answer: str, expected: str) -> DeviceError:
        if self._dialogue is not None:
            self._dialogue.lose_step()
        echo = "It sends back what it is told: switch its echo off. " if answer.startswith(line) else ""
        return DeviceError(
            f"the light at {self._settings.port} answers {line!r} with {answer!r}; expected was {expected}. "
            f"{echo}Look at the words in the rig file's [light.device]"
        )

    def _close(self) -> None:
        port, self._port, self._dialogue = self._port, None, None
        if port is not None:
            with suppress(DeviceError):
                port.close()
