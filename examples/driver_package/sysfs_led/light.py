"""An LED of Linux' LED class: a number in a file is its brightness."""

from __future__ import annotations

import math
from pathlib import Path

from drivers.errors import DeviceError, DeviceLostError
from drivers.lease import LEVEL_LIMITS, check_lease, check_level
from drivers.light import LightDescription, LightState
from drivers.readback import Setting, confirm
from sysfs_led.settings import SysfsLedSettings


class SysfsLed:
    """Satisfies `drivers.light.Light`, but for the lease: the process that supervises every real light ends that.

    Parameters
    ----------
    settings : SysfsLedSettings
    """

    def __init__(self, settings: SysfsLedSettings) -> None:
        self._settings = settings
        self._folder = Path(settings.folder) / settings.led
        self._full = 0

    def connect(self) -> None:
        """Take the LED from whatever blinks it, dark; safe to call twice."""
        if self._full:
            return
        full = self._read("max_brightness")
        self._write("trigger", "none")
        self._write("brightness", "0")
        self._full = full

    def disconnect(self) -> None:
        """Switch off; safe to call twice, and without `connect`."""
        try:
            self.off()
        finally:
            self._full = 0

    def describe(self) -> LightDescription:
        """Return what the LED is; it has no serial number but its name."""
        steps = Setting("steps of brightness", float(self._connected()))
        return LightDescription("Linux", "LED class", self._settings.led, LEVEL_LIMITS, settings=(steps,))

    def on(self, level: float, max_seconds: float) -> LightState:
        """Shine at `level`; the supervisor switches off after `max_seconds`."""
        full = self._connected()
        check_level(level)
        check_lease(max_seconds, self._settings.longest_lease_s)
        steps = round(level * full)
        self._write("brightness", str(steps))
        confirm("the brightness", steps, self._read("brightness"), 0, "steps")
        return self.read()

    def off(self) -> LightState:
        """Go dark and confirm it; safe to call at any time."""
        if not self._full:
            return LightState(lit=False, level=0.0, monitor=math.nan, temperature=math.nan)
        self._write("brightness", "0")
        return self.read()

    def read(self) -> LightState:
        """Return the state as the kernel reports it."""
        level = self._read("brightness") / self._connected()
        return LightState(lit=level > 0.0, level=level, monitor=math.nan, temperature=math.nan)

    def _connected(self) -> int:
        if not self._full:
            raise DeviceError("the light is not connected. Call connect() first.")
        return self._full

    def _read(self, name: str) -> int:
        try:
            return int((self._folder / name).read_text())
        except (OSError, ValueError) as error:
            raise self._failed(error) from None

    def _write(self, name: str, value: str) -> None:
        try:
            (self._folder / name).write_text(value)
        except OSError as error:
            raise self._failed(error) from None

    def _failed(self, error: Exception) -> DeviceError:
        if isinstance(error, PermissionError):
            return DeviceError(f"no permission to write to {self._folder}. Let a udev rule give it to your group")
        if isinstance(error, FileNotFoundError):
            there = ", ".join(sorted(entry.name for entry in self._folder.parent.glob("*"))) or "none"
            return DeviceLostError(
                f"there is no LED {self._settings.led!r}; LEDs here: {there}. Correct led in rig.toml"
            )
        return DeviceError(f"the LED {self._settings.led!r} failed: {error}. Look at {self._folder}")
