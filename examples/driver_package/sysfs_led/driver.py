"""What the entry point `light.sysfs_led` names."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from drivers.driver import DeviceState, Driver, FoundDevice
from sysfs_led.light import SysfsLed
from sysfs_led.settings import SysfsLedSettings


def _find() -> Iterator[FoundDevice]:
    for led in sorted(Path(SysfsLedSettings.model_fields["folder"].default).glob("*")):
        # Those with two colons are the lamps of keyboards and network sockets.
        if "::" not in led.name:
            yield FoundDevice(f"LED {led.name}", str(led), DeviceState.FOUND)


DRIVER = Driver("light", SysfsLedSettings, lambda settings, _: SysfsLed(settings), _find)
