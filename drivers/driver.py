"""What a driver says of itself: the kind of its devices, its settings, how to open one and how to find it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal

from drivers.device_settings import DeviceSettings

Kind = Literal["camera", "light", "stage"]


class DeviceState(Enum):
    """Whether a device that is attached can be used; the value is the word for it."""

    FOUND = "found"
    UNKNOWN = "unknown"
    BUSY = "busy"
    NO_PERMISSION = "no permission"


@dataclass(frozen=True, slots=True)
class FoundDevice:
    """A device that is attached to this computer or its network.

    Attributes
    ----------
    name : str
        Make, model and serial number, as far as they are known.
    where : str
        E.g. a port, a USB address or an address in the network.
    state : DeviceState
    remedy : str
        What to do about its state; ``""`` where it can be used.
    kind : str
        ``"camera"``, ``"light"``, ``"stage"``; ``""`` where it is unknown. `drivers.discovery` fills it in, like
    driver : str
        What ``driver`` in the rig file is for it; ``""`` where it is unknown.
    """

    name: str
    where: str
    state: DeviceState
    remedy: str = ""
    kind: str = ""
    driver: str = ""


def _nothing_to_find() -> Iterable[FoundDevice]:
    return ()


@dataclass(frozen=True, slots=True)
class Driver:
    """What the entry-point group ``halfangle.drivers`` holds, one for each driver; the name there is ``KIND.NAME``.

    Attributes
    ----------
    kind : {"camera", "light", "stage"}
    settings : type of DeviceSettings
        Of the table ``[KIND.device]``.
    open : callable
        Takes the settings and the whole table ``[KIND]`` (``serial_number``, a camera's ``width`` and ``height``);
        returns the device, not yet connected. What belongs to a vendor is imported when it connects.
    find : callable
        Yields the devices of this driver that are attached, and changes nothing about any of them. Raises
        `drivers.errors.DriverNotFoundError` where what it needs is not installed.
    """

    kind: Kind
    settings: type[DeviceSettings]
    open: Callable[[Any, Mapping[str, Any]], Any]
    find: Callable[[], Iterable[FoundDevice]] = _nothing_to_find
