"""What is attached to this computer, and whether it can be used."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

from drivers.driver import DeviceState, FoundDevice, Kind
from drivers.errors import DeviceError
from drivers.registry import driver_names, find_driver
from drivers.serial_link.discovery import find_serial_ports


@dataclass(slots=True)
class Discovery:
    """What was found, and what could not be looked for.

    Attributes
    ----------
    devices : list of FoundDevice
    not_looked_for : list of str
        Each with the reason and what to do.
    """

    devices: list[FoundDevice] = field(default_factory=list)
    not_looked_for: list[str] = field(default_factory=list)

    def look(self, what: str, find: Callable[[], Iterable[FoundDevice]]) -> None:
        """Add what `find` finds, or why it cannot look for it."""
        try:
            self.devices.extend(find())
        except DeviceError as error:
            self.not_looked_for.append(f"{what}: {error}")


def discover() -> Discovery:
    """Look for the devices of every driver, and for serial ports; nothing is changed about any of them."""
    found = Discovery()
    for kind, name in driver_names():
        found.look(f"{kind}.{name}", partial(_found_by, kind, name))
    found.look("serial ports", find_serial_ports)
    return found


def _found_by(kind: Kind, name: str) -> Iterable[FoundDevice]:
    for device in find_driver(kind, name).find():
        # What a driver knows how to talk to is its own; the others it met are nobody's.
        yield device if device.state is DeviceState.UNKNOWN else replace(device, kind=kind, driver=name)


def discovery_figures(found: Discovery) -> dict[str, Any]:
    """Return what is attached, as JSON has it."""
    return {
        "devices": [{**asdict(device), "state": device.state.value} for device in found.devices],
        "not_looked_for": found.not_looked_for,
    }


def discovery_text(found: Discovery) -> str:
    """Return what is attached, a line each, with what to do."""
    lines = [line for device in found.devices for line in _lines(device)] or ["nothing is attached that a driver knows"]
    return "\n".join([*lines, *(f"not looked for: {why}" for why in found.not_looked_for)])


def _lines(device: FoundDevice) -> list[str]:
    driver = f'{device.kind}, driver = "{device.driver}"' if device.driver else "no driver"
    line = f"{device.state.value:<13}  {device.name}  ({driver}; {device.where})"
    return [line, f"{'':<13}  {device.remedy}"] if device.remedy else [line]
