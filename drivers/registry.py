"""From a driver's name in the rig file to open devices; a driver is imported when it is asked for."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from difflib import get_close_matches
from functools import cache
from importlib import import_module
from importlib.metadata import EntryPoint, entry_points
from typing import Any, NamedTuple, get_args

from drivers.camera import Camera
from drivers.clock import Clock, RealClock
from drivers.device_settings import DeviceSettings, settings_from_table
from drivers.driver import Driver, Kind
from drivers.errors import DeviceError, DriverNotFoundError
from drivers.light import Light
from drivers.stage import Stage
from drivers.supervised_light import SupervisedLight, supervisor_command


class Devices(NamedTuple):
    """The devices of a rig, and the clock that its seconds are counted by."""

    camera: Camera
    light: Light
    stage: Stage
    clock: Clock = RealClock()


KINDS: tuple[Kind, ...] = get_args(Kind)
SIMULATED = "simulated"
GROUP = "halfangle.drivers"
"""Entry-point group of drivers that other packages bring."""

_OWN = {
    "camera.genicam": "drivers.genicam.driver:DRIVER",
    "camera.oak": "drivers.oak.driver:DRIVER",
    "light.scpi": "drivers.scpi_light.driver:DRIVER",
    "light.serial": "drivers.serial_light.driver:DRIVER",
    "stage.grbl": "drivers.grbl.driver:DRIVER",
    "stage.zaber": "drivers.zaber.driver:DRIVER",
}


def known_drivers(kind: Kind) -> tuple[str, ...]:
    """Return the names that ``driver`` may have in the table of a kind, `SIMULATED` first."""
    return (SIMULATED, *sorted(name.partition(".")[2] for name in _entries() if name.startswith(f"{kind}.")))


def driver_names() -> Iterator[tuple[Kind, str]]:
    """Yield the kind and the name of every driver of real devices."""
    yield from ((kind, name) for kind in KINDS for name in known_drivers(kind)[1:])


def find_driver(kind: Kind, name: str) -> Driver:
    """Return the driver of a real device.

    Raises
    ------
    DriverNotFoundError
        If there is none of that name, which names those that there are; or if it cannot be loaded.
    """
    entry = _entries().get(f"{kind}.{name}")
    if entry is None:
        raise DriverNotFoundError(_unknown(kind, name))
    try:
        driver = entry.load()
    # A package of somebody else may fail in any way while it is imported.
    except Exception as error:
        raise DriverNotFoundError(f"the driver {entry.name} ({entry.value}) cannot be loaded: {error!r}") from error
    if not isinstance(driver, Driver) or driver.kind != kind:
        raise DriverNotFoundError(f"{entry.value} is {driver!r}; expected was the drivers.driver.Driver of a {kind}")
    return driver


def settings_of(kind: Kind, name: str) -> type[DeviceSettings]:
    """Return what the table ``[KIND.device]`` of a rig file may hold; nothing for a simulated device.

    Raises
    ------
    DriverNotFoundError
        As `find_driver`.
    """
    return DeviceSettings if name == SIMULATED else find_driver(kind, name).settings


def open_devices(rig: Mapping[str, Any]) -> Devices:
    """Return the devices of a rig, not yet connected; a real light is owned by a process that supervises it.

    Parameters
    ----------
    rig : mapping
        The parsed rig file; ``rig[kind]["driver"]`` names the driver of each kind, ``rig[kind]["device"]`` holds its
        settings.

    Raises
    ------
    DriverNotFoundError
        If a driver is unknown; names those that are known.
    DeviceError
        If simulated and real devices are mixed.
    """
    check_one_world({kind: str(rig[kind]["driver"]) for kind in KINDS})
    if is_simulated(rig):
        world, camera, light, stage = import_module("drivers.simulated.devices").open_simulated(rig)
        return Devices(camera, light, stage, world.clock)
    # Its table is looked at here, since the supervisor could only die of it.
    _settings("light", rig)
    supervised = SupervisedLight(supervisor_command({"light": rig["light"]}))
    return Devices(_opened("camera", rig), supervised, _opened("stage", rig))


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
    if not is_simulated(rig):
        raise DeviceError("faults on purpose are for a simulated rig; this one is real. Leave --faults out")
    world, camera, light, stage = import_module("drivers.simulated.devices").open_faulty(rig, faults)
    return Devices(camera, light, stage, world.clock)


def open_lone_light(rig: Mapping[str, Any]) -> Light:
    """Return the light of a rig alone, not yet connected, for the process that supervises it.

    Raises
    ------
    DriverNotFoundError
        If its driver is unknown.
    """
    if rig["light"]["driver"] != SIMULATED:
        lone: Light = _opened("light", rig)
        return lone
    light: Light = import_module("drivers.simulated.devices").open_lone_light(rig)
    return light


def is_simulated(rig: Mapping[str, Any]) -> bool:
    """Tell whether every device of a parsed rig file is simulated."""
    return all(rig[kind]["driver"] == SIMULATED for kind in KINDS)


def check_one_world(names: Mapping[Kind, str]) -> None:
    """Refuse a mixed rig: a simulated camera sees no real light, and the other way round.

    Parameters
    ----------
    names : mapping
        Name of the driver by kind.

    Raises
    ------
    DeviceError
        Names which are which.
    """
    simulated = [kind for kind, name in names.items() if name == SIMULATED]
    if simulated and len(simulated) < len(names):
        real = [f"{kind} = {name!r}" for kind, name in names.items() if name != SIMULATED]
        raise DeviceError(
            f"the rig mixes simulated ({', '.join(simulated)}) and real devices ({', '.join(real)}); "
            "simulated devices share one scene without the real ones. Make all three simulated, or none."
        )


def _opened(kind: Kind, rig: Mapping[str, Any]) -> Any:
    return find_driver(kind, str(rig[kind]["driver"])).open(_settings(kind, rig), rig[kind])


def _settings(kind: Kind, rig: Mapping[str, Any]) -> DeviceSettings:
    return settings_from_table(find_driver(kind, str(rig[kind]["driver"])).settings, rig[kind].get("device", {}))


@cache
def _entries() -> Mapping[str, EntryPoint]:
    """Return the entry point of each driver by ``KIND.NAME``; those of this package cannot be replaced."""
    others = {entry.name: entry for entry in entry_points(group=GROUP)}
    return others | {name: EntryPoint(name, value, GROUP) for name, value in _OWN.items()}


def _unknown(kind: Kind, name: str) -> str:
    known = known_drivers(kind)
    close = get_close_matches(name, known, n=1)
    hint = f" Did you mean {close[0]!r}?" if close else ""
    return f"{kind}.driver is {name!r}; known drivers of a {kind}: {', '.join(known)}.{hint}"
