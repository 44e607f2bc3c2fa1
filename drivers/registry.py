"""From a driver's name in the rig file to open devices; a driver is imported when it is asked for."""

from __future__ import annotations

from collections.abc import Mapping
from difflib import get_close_matches
from importlib import import_module
from typing import Any, NamedTuple

from drivers.camera import Camera
from drivers.clock import Clock, RealClock
from drivers.errors import DeviceError, DriverNotFoundError
from drivers.light import Light
from drivers.stage import Stage


class Devices(NamedTuple):
    """The devices of a rig, and the clock that its seconds are counted by."""

    camera: Camera
    light: Light
    stage: Stage
    clock: Clock = RealClock()


KINDS = ("camera", "light", "stage")
SIMULATED = "simulated"
# kind -> names of its drivers
KNOWN_DRIVERS: Mapping[str, tuple[str, ...]] = dict.fromkeys(KINDS, (SIMULATED,))


def open_devices(rig: Mapping[str, Any]) -> Devices:
    """Return the devices of a rig, not yet connected.

    Parameters
    ----------
    rig : mapping
        The parsed rig file; ``rig[kind]["driver"]`` names the driver of each kind.

    Raises
    ------
    DriverNotFoundError
        If a driver is unknown; names those that are known.
    DeviceError
        If simulated and real devices are mixed.
    """
    names = {kind: str(rig[kind]["driver"]) for kind in KINDS}
    for kind, name in names.items():
        _check_known(kind, name)
    _check_one_world(names)
    devices = import_module("drivers.simulated.devices")
    world, camera, light, stage = devices.open_simulated(rig)
    return Devices(camera, light, stage, world.clock)


def open_devices_with_faults(rig: Mapping[str, Any], faults: tuple[Any, ...]) -> Devices:
    """Return the devices of a simulated rig, which go wrong as a script says.

    Parameters
    ----------
    rig : mapping
        As for `open_devices`.
    faults : tuple of drivers.simulated.faults.Fault

    Raises
    ------
    DeviceError
        If the rig is not simulated.
    """
    if any(rig[kind]["driver"] != SIMULATED for kind in KINDS):
        raise DeviceError("faults on purpose are for a simulated rig; this one is real. Leave --faults out")
    devices = import_module("drivers.simulated.devices")
    world, camera, light, stage = devices.open_faulty(rig, faults)
    return Devices(camera, light, stage, world.clock)


def open_lone_light(rig: Mapping[str, Any]) -> Light:
    """Return the light of a rig alone, not yet connected, for the process that supervises it.

    Raises
    ------
    DriverNotFoundError
        If its driver is unknown.
    """
    _check_known("light", str(rig["light"]["driver"]))
    light: Light = import_module("drivers.simulated.devices").open_lone_light(rig)
    return light


def _check_known(kind: str, name: str) -> None:
    known = KNOWN_DRIVERS[kind]
    if name not in known:
        close = get_close_matches(name, known, n=1)
        hint = f" Did you mean {close[0]!r}?" if close else ""
        raise DriverNotFoundError(f"{kind}.driver is {name!r}; known drivers of a {kind}: {', '.join(known)}.{hint}")


def _check_one_world(names: Mapping[str, str]) -> None:
    """Refuse a mixed rig: a simulated camera sees no real light, and the other way round."""
    simulated = [kind for kind, name in names.items() if name == SIMULATED]
    if simulated and len(simulated) < len(names):
        real = [f"{kind} = {name!r}" for kind, name in names.items() if name != SIMULATED]
        raise DeviceError(
            f"the rig mixes simulated ({', '.join(simulated)}) and real devices ({', '.join(real)}); "
            "simulated devices share one scene without the real ones. Make all three simulated, or none."
        )
