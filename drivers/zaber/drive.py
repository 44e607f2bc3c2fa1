"""The axes of an open chain of Zaber devices: looked at, moved, halted."""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import suppress

from drivers.axes.motion import AxisMotion, duration
from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceLostError, DeviceTimeoutError
from drivers.zaber.devices import Chain
from drivers.zaber.flags import blocked
from drivers.zaber.link import ZaberLink
from drivers.zaber.settings import ZaberAxis, ZaberSettings

_LONGEST_STOP = 3.0  # seconds; a command has five in all
_POLL = 0.02

Flags = dict[str, tuple[str, ...]]


class ZaberDrive:
    """What moves the axes of a stage.

    Parameters
    ----------
    link : ZaberLink
    chain : Chain
    settings : ZaberSettings
    clock : Clock

    Attributes
    ----------
    n_stops : int
        How often it was told to stop; who moves compares it with what it was when the call came in.
    """

    def __init__(self, link: ZaberLink, chain: Chain, settings: ZaberSettings, clock: Clock) -> None:
        self.link, self.chain = link, chain
        self._settings, self._clock = settings, clock
        self.n_stops = 0

    def look(self) -> tuple[dict[str, float], Flags]:
        """Return the position of every axis, degrees or millimetres, whatever it is worth, and its warning flags."""
        replies = {axis: self.link.ask("get pos", *axis.place) for axis in self._settings.axes}
        flags = {axis.name: self.link.flags(reply, *axis.place) for axis, reply in replies.items()}
        return {axis.name: axis.position_from_native(float(reply.data)) for axis, reply in replies.items()}, flags

    def position(self) -> dict[str, float]:
        """Return the position of every axis, degrees or millimetres.

        Raises
        ------
        DeviceError
            If an axis has a fault or no reference.
        """
        position, flags = self.look()
        errors = [error for axis in position if (error := blocked(axis, flags[axis]))]
        if errors:
            raise type(errors[0])(" ".join(map(str, errors)))
        return position

    def run(self, commands: Mapping[ZaberAxis, str], seconds: float, n_stops: int) -> None:
        """Let axes move until they rest; whatever fails, all rests then.

        Parameters
        ----------
        commands : mapping of ZaberAxis to str
        seconds : float
            The limit.
        n_stops : int
            What `n_stops` was before.

        Raises
        ------
        DeviceError
            If a command is refused, an axis has a fault, or `stop` was called meanwhile.
        DeviceTimeoutError
            If an axis still moves when the time is over.
        """
        try:
            for axis, command in commands.items():
                self.link.ask(command, *axis.place)
            self._wait(tuple(commands), seconds, n_stops)
        except DeviceLostError:
            raise
        except DeviceError:
            # What failed first is the message.
            with suppress(DeviceError):
                self.halt()
            raise

    def stop(self) -> None:
        """Halt every axis now; `run` in another thread ends with an error."""
        self.n_stops += 1
        self.halt()

    def halt(self) -> None:
        """Bring every axis to rest by deceleration.

        Raises
        ------
        DeviceTimeoutError
            If one goes on.
        """
        for address in self._settings.addresses:
            self.link.ask("stop", address)
        seconds = min(_LONGEST_STOP, 1.0 + max(facts.stopping_time for facts in self.chain.axes.values()))
        deadline = self._clock.now() + seconds
        while not all(self.link.ask("", address).is_idle for address in self._settings.addresses):
            if self._clock.now() > deadline:
                raise DeviceTimeoutError(f"the stage still moves {seconds:.1f} s after it was stopped. Cut its power")
            self._clock.sleep(_POLL)

    def duration(self, start: Mapping[str, float], target: Mapping[str, float]) -> float:
        """Return the seconds from `start` to `target`, settling included: of the axis that takes longest."""
        axes = [axis for axis in self._settings.axes if axis.name in target]
        seconds = max((self._axis_duration(axis, start[axis.name], target[axis.name]) for axis in axes), default=0.0)
        return seconds + self._settings.settling_time_s if seconds > 0.0 else 0.0

    def _axis_duration(self, axis: ZaberAxis, start: float, target: float) -> float:
        way = axis.native_from_position(target) - axis.native_from_position(start)
        facts = self.chain.axes[axis.name]
        return duration([AxisMotion(float(way), facts.max_rate, facts.acceleration)])

    def _wait(self, axes: tuple[ZaberAxis, ...], seconds: float, n_stops: int) -> None:
        deadline = self._clock.now() + seconds
        while True:
            rests = self._rest(axes)
            if self.n_stops != n_stops:
                raise DeviceError("the motion was stopped. Find out why, then move again.")
            if rests:
                return
            if self._clock.now() > deadline:
                names = ", ".join(axis.name for axis in axes)
                raise DeviceTimeoutError(f"axes {names} still move after {seconds:.1f} s. Look at the stage, home it")
            self._clock.sleep(_POLL)

    def _rest(self, axes: tuple[ZaberAxis, ...]) -> bool:
        """Return whether all rest; raise for an axis with a fault."""
        replies = {axis: self.link.ask("", *axis.place) for axis in axes}
        for axis, reply in replies.items():
            # While it homes, an axis has no reference, and need not have one.
            faults = [flag for flag in self.link.flags(reply, *axis.place) if flag.startswith("F")]
            if error := blocked(axis.name, faults):
                raise error
        return all(reply.is_idle for reply in replies.values())
