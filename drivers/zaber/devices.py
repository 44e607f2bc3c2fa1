"""What the devices of a chain tell of themselves, and whether the stage of rig.toml can live with it."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from drivers.axes.settings import UNITS
from drivers.errors import DeviceError, DeviceTimeoutError
from drivers.readback import Setting
from drivers.zaber.link import ZaberLink
from drivers.zaber.settings import ZaberAxis, ZaberSettings

# Units of `maxspeed` per microstep per second; of `accel`, per 10000 microsteps per second squared.
_SPEED_UNITS = 1.6384
_ACCELERATION_UNITS = _SPEED_UNITS / 1e4

_HOMING_MARGIN, _LONGEST_HOMING = 10.0, 150.0  # seconds


@dataclass(frozen=True, slots=True)
class AxisFacts:
    """What an axis is set to, in its device's units and seconds.

    Attributes
    ----------
    low, high : float
        Travel.
    max_rate : float
        Speed of moves.
    acceleration : float
        Infinite where there is no ramp.
    homing_rate : float
        Speed on the way to the home sensor.
    """

    low: float
    high: float
    max_rate: float
    acceleration: float
    homing_rate: float

    @property
    def homing_limit(self) -> float:
        """Seconds in which homing ends, one way or the other; an endless turntable has no travel to go by."""
        return min(_LONGEST_HOMING, _HOMING_MARGIN + 2.0 * (self.high - self.low) / self.homing_rate)

    @property
    def stopping_time(self) -> float:
        """Seconds from full speed to rest."""
        return self.max_rate / self.acceleration


@dataclass(frozen=True, slots=True)
class Chain:
    """The devices of a stage.

    Attributes
    ----------
    device_ids, serial_numbers, firmware : tuple of str
        Of each device, in the order of `ZaberSettings.addresses`.
    axes : mapping of str to AxisFacts
        By the axis' name.
    """

    device_ids: tuple[str, ...]
    serial_numbers: tuple[str, ...]
    firmware: tuple[str, ...]
    axes: Mapping[str, AxisFacts]

    def settings(self, axes: tuple[ZaberAxis, ...]) -> tuple[Setting, ...]:
        """Return the speed of each axis in degrees or millimetres per second."""
        return tuple(
            Setting(f"{axis.name}_max_speed", self.axes[axis.name].max_rate / abs(axis.scale), f"{UNITS[axis.kind]}/s")
            for axis in axes
        )


def read_chain(link: ZaberLink, settings: ZaberSettings) -> Chain:
    """Ask the devices who and what they are, and refuse a chain that does not fit.

    Raises
    ------
    DeviceError
        With all that does not fit: axes that are not there, or limits narrower than those of the stage.
    DeviceTimeoutError
        If nothing that speaks the protocol answers.
    """
    _check_present(link, settings)
    device_ids, serials, firmware, counts = (
        tuple(link.ask(f"get {name}", address).data for address in settings.addresses)
        for name in ("deviceid", "system.serial", "version", "system.axiscount")
    )
    n_axes = dict(zip(settings.addresses, counts, strict=True))
    missing = list(_missing_axes(settings, n_axes))
    facts = {} if missing else {axis.name: _facts(link, axis) for axis in settings.axes}
    problems = missing or [text for axis in settings.axes for text in _misfits(axis, facts[axis.name])]
    if problems:
        raise DeviceError(f"the devices at {settings.port} do not fit rig.toml: {'; '.join(problems)}.")
    return Chain(device_ids, serials, firmware, facts)


def _check_present(link: ZaberLink, settings: ZaberSettings) -> None:
    absent = [address for address in settings.addresses if not _answers(link, address)]
    if not absent:
        return
    present = link.addresses()
    if not present:
        raise DeviceTimeoutError(
            f"nothing at {settings.port} answers as a Zaber device does at {settings.baud_rate} baud. Look at the "
            "power and the cables, whether port names another device, and at baud_rate"
        )
    # One that was late is there all the same.
    absent = [address for address in absent if address not in present]
    if absent:
        raise DeviceError(
            f"no device {', '.join(map(str, absent))} in the chain at {settings.port}; found: "
            f"{', '.join(map(str, present))}. Correct device_address, or look at the power and the cables of the chain."
        )


def _answers(link: ZaberLink, address: int) -> bool:
    try:
        link.ask("", address)
    except DeviceTimeoutError:
        return False
    return True


def _missing_axes(settings: ZaberSettings, n_axes: Mapping[int, str]) -> Iterator[str]:
    for axis in settings.axes:
        count = n_axes[axis.device_address]
        if axis.axis_number > int(count):
            yield (
                f"axis {axis.name}: device {axis.device_address} has no axis {axis.axis_number}, it has {count}; "
                "correct axis_number"
            )


def _facts(link: ZaberLink, axis: ZaberAxis) -> AxisFacts:
    low, high, speed, acceleration, approach = (
        link.number(name, *axis.place)
        for name in ("limit.min", "limit.max", "maxspeed", "accel", "limit.approach.maxspeed")
    )
    ramp = acceleration / _ACCELERATION_UNITS if acceleration else math.inf
    # Homing goes at the lesser of the two; older firmware has the first alone.
    homing = min(speed, approach) if approach > 0.0 else speed
    return AxisFacts(low, high, speed / _SPEED_UNITS, ramp, homing / _SPEED_UNITS)


def _misfits(axis: ZaberAxis, facts: AxisFacts) -> Iterator[str]:
    ends = sorted(axis.native_from_position(end) for end in axis.soft_limits)
    if not (facts.low <= ends[0] and ends[1] <= facts.high):
        yield (
            f"axis {axis.name}: soft_limits are {ends[0]:g} to {ends[1]:g} in its units and the device's (limit.min, "
            f"limit.max) are {facts.low:g} to {facts.high:g}; correct zero, scale or soft_limits"
        )
    if not facts.max_rate > 0.0:
        yield f"axis {axis.name}: maxspeed is {facts.max_rate * _SPEED_UNITS:g}; it must be above 0"
    if not facts.acceleration > 0.0:
        yield f"axis {axis.name}: accel is no number above 0"
    # Positions are whole in the device's units.
    if axis.tolerance * abs(axis.scale) < 0.5:
        yield (
            f"axis {axis.name}: tolerance {axis.tolerance:g} is finer than a microstep; allowed from "
            f"{0.5 / abs(axis.scale):.3g}"
        )
