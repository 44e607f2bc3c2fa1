"""A stage of Zaber's devices: turntable and tilt, or any goniometer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress

from drivers.clock import Clock, RealClock
from drivers.errors import DeviceError, DeviceLimitError, DeviceLostError, DeviceTimeoutError
from drivers.grbl.motion import AxisMotion, duration
from drivers.stage import StageDescription
from drivers.zaber.devices import Chain, read_chain
from drivers.zaber.flags import blocked, is_blocking, noted
from drivers.zaber.link import ZaberLink
from drivers.zaber.settings import ZaberAxis, ZaberSettings

_MOVE_MARGIN = 2.0  # seconds that a move may take besides half as long again as its way explains
_LONGEST_STOP = 3.0  # seconds; a command has five in all
_POLL = 0.02


class ZaberStage:
    """A stage of Zaber's devices with the ASCII protocol.

    Its axes move all at once, each at the speed and acceleration that its device is set to; no setting of a device is
    changed, and no driver enabled.

    Parameters
    ----------
    settings : ZaberSettings
    clock : Clock, optional
        The computer's if not given.
    """

    def __init__(self, settings: ZaberSettings, clock: Clock | None = None) -> None:
        self._settings = settings
        self._clock = clock or RealClock()
        self._link: ZaberLink | None = None
        self._chain = Chain((), (), (), {})
        self._n_stops = 0

    def connect(self) -> None:
        """Open the port, bring the devices to rest and compare them with the settings; safe to call twice.

        Raises
        ------
        DriverNotFoundError
            If zaber-motion is not installed.
        DeviceError
            If the port cannot be opened, or the devices do not fit.
        DeviceTimeoutError
            If nothing that speaks the protocol answers.
        """
        if self._link is not None:
            return
        link = ZaberLink(self._settings.port, self._settings.baud_rate)
        try:
            self._chain = read_chain(link, self._settings)
            self._halt(link)
        except BaseException:
            link.close()
            raise
        self._link = link

    def disconnect(self) -> None:
        """Stop and close; safe to call twice, and without `connect`."""
        try:
            self.stop()
        finally:
            self._close()

    def describe(self) -> StageDescription:
        """Return what the connected stage is; several devices are joined by ``+``."""
        with self._open():
            return StageDescription(
                make="Zaber",
                model=f"device id {'+'.join(self._chain.device_ids)}",
                serial_number="+".join(self._chain.serial_numbers),
                axes=tuple(axis.describe() for axis in self._settings.axes),
                firmware="+".join(self._chain.firmware),
                settings=self._chain.settings(self._settings.axes),
            )

    def home(self) -> None:
        """Find the zero of every axis, and go there; a stall is forgotten.

        Raises
        ------
        DeviceError
            If a device refuses or fails, or `stop` was called.
        DeviceTimeoutError
            If an axis does not find its sensor.
        """
        with self._open() as link:
            n_stops, axes = self._n_stops, self._settings.axes
            for axis in axes:
                link.ask("warnings clear", *axis.place)
            limit = max(self._chain.axes[axis.name].homing_limit for axis in axes)
            self._run(link, dict.fromkeys(axes, "home"), limit, n_stops)
            self._go(link, {axis.name: 0.0 for axis in axes}, n_stops)

    def move(self, target: Mapping[str, float]) -> dict[str, float]:
        """Move the named axes, wait until they rest, return every axis' read-back.

        Raises
        ------
        DeviceLimitError
            If an axis does not exist or a target is outside its soft limits; nothing has been sent then.
        DeviceError
            If an axis has no reference or a fault, if `stop` was called, or if an axis is not where it should be; all
            rests then.
        DeviceTimeoutError
            If the move takes longer than its way, speed and acceleration explain.
        """
        with self._open() as link:
            n_stops = self._n_stops
            self._check(target)
            return self._go(link, target, n_stops)

    def move_duration(self, target: Mapping[str, float]) -> float:
        """Return the seconds that `move` would take from here, settling included; from zero, if it is to be homed yet.

        Raises
        ------
        DeviceLimitError
            If `move` would refuse the target.
        """
        with self._open() as link:
            self._check(target)
            position, flags = self._look(link)
        homeless = any(is_blocking(flag) for axis_flags in flags.values() for flag in axis_flags)
        return self._duration(dict.fromkeys(position, 0.0) if homeless else position, target)

    def read(self) -> dict[str, float]:
        """Return the position of every axis in degrees or millimetres.

        Raises
        ------
        DeviceError
            If an axis has a fault or no reference, so that its position means nothing.
        """
        with self._open() as link:
            return self._position(link)

    def stop(self) -> None:
        """Halt every axis now, by deceleration; whoever waits for a move is told."""
        self._n_stops += 1
        if self._link is not None:
            with self._open() as link:
                self._halt(link)

    def _close(self) -> None:
        link, self._link = self._link, None
        if link is not None:
            link.close()

    @contextmanager
    def _open(self) -> Iterator[ZaberLink]:
        """Have the link; a port that is gone is closed, so that it can be opened again."""
        link = self._link
        if link is None:
            raise DeviceError("the Zaber stage is not connected. Call connect() first.")
        try:
            yield link
        except DeviceLostError:
            self._close()
            raise

    def _go(self, link: ZaberLink, target: Mapping[str, float], n_stops: int) -> dict[str, float]:
        start = self._position(link)
        seconds = self._duration(start, target)
        moved = [axis for axis in self._settings.axes if axis.name in target]
        if seconds > 0.0:
            commands = {axis: f"move abs {axis.native_from_position(target[axis.name])}" for axis in moved}
            self._run(link, commands, 1.5 * seconds + _MOVE_MARGIN, n_stops)
            self._clock.sleep(self._settings.settling_time_s)
        arrived = self._position(link)
        self._check_arrival(link, target, arrived)
        return arrived

    def _run(self, link: ZaberLink, commands: Mapping[ZaberAxis, str], seconds: float, n_stops: int) -> None:
        """Let axes move until they rest; whatever fails, all rests then."""
        try:
            for axis, command in commands.items():
                link.ask(command, *axis.place)
            self._wait(link, tuple(commands), seconds, n_stops)
        except DeviceLostError:
            raise
        except DeviceError:
            # What failed first is the message.
            with suppress(DeviceError):
                self._halt(link)
            raise

    def _wait(self, link: ZaberLink, axes: tuple[ZaberAxis, ...], seconds: float, n_stops: int) -> None:
        deadline = self._clock.now() + seconds
        while True:
            rests = self._rest(link, axes)
            if self._n_stops != n_stops:
                raise DeviceError("the motion was stopped. Find out why, then move again.")
            if rests:
                return
            if self._clock.now() > deadline:
                names = ", ".join(axis.name for axis in axes)
                raise DeviceTimeoutError(f"axes {names} still move after {seconds:.1f} s. Look at the stage, home it")
            self._clock.sleep(_POLL)

    def _rest(self, link: ZaberLink, axes: tuple[ZaberAxis, ...]) -> bool:
        """Return whether all rest; raise for an axis with a fault."""
        replies = {axis: link.ask("", *axis.place) for axis in axes}
        for axis, reply in replies.items():
            # While it homes, an axis has no reference, and need not have one.
            faults = [flag for flag in link.flags(reply, *axis.place) if flag.startswith("F")]
            if error := blocked(axis.name, faults):
                raise error
        return all(reply.is_idle for reply in replies.values())

    def _halt(self, link: ZaberLink) -> None:
        for address in self._settings.addresses:
            link.ask("stop", address)
        seconds = min(_LONGEST_STOP, 1.0 + max(facts.stopping_time for facts in self._chain.axes.values()))
        deadline = self._clock.now() + seconds
        while not all(link.ask("", address).is_idle for address in self._settings.addresses):
            if self._clock.now() > deadline:
                raise DeviceTimeoutError(f"the stage still moves {seconds:.1f} s after it was stopped. Cut its power")
            self._clock.sleep(_POLL)

    def _position(self, link: ZaberLink) -> dict[str, float]:
        position, flags = self._look(link)
        errors = [error for axis in position if (error := blocked(axis, flags[axis]))]
        if errors:
            raise type(errors[0])(" ".join(map(str, errors)))
        return position

    def _look(self, link: ZaberLink) -> tuple[dict[str, float], dict[str, tuple[str, ...]]]:
        """Return the position of every axis, whatever it is worth, and its flags."""
        replies = {axis: link.ask("get pos", *axis.place) for axis in self._settings.axes}
        flags = {axis.name: link.flags(reply, *axis.place) for axis, reply in replies.items()}
        return {axis.name: axis.position_from_native(float(reply.data)) for axis, reply in replies.items()}, flags

    def _check(self, target: Mapping[str, float]) -> None:
        axes = {axis.name: axis.describe() for axis in self._settings.axes}
        for name, value in target.items():
            if name not in axes:
                raise DeviceLimitError(f"the stage has no axis {name!r}; its axes are {', '.join(axes)}")
            axes[name].soft_limits.check(f"target of axis {name}", value, "Leave that pose out of the plan.")

    def _check_arrival(self, link: ZaberLink, target: Mapping[str, float], arrived: Mapping[str, float]) -> None:
        astray = [
            axis
            for axis in self._settings.axes
            if axis.name in target and abs(arrived[axis.name] - target[axis.name]) > axis.tolerance
        ]
        if astray:
            _, flags = self._look(link)
            texts = [
                f"axis {axis.name} is at {arrived[axis.name]:g} instead of {target[axis.name]:g} "
                f"(flags: {noted(flags[axis.name]) or 'none'})"
                for axis in astray
            ]
            raise DeviceError(f"the stage did not arrive: {'; '.join(texts)}. Home it, then move again.")

    def _duration(self, start: Mapping[str, float], target: Mapping[str, float]) -> float:
        seconds = max((self._axis_duration(axis, start, target) for axis in self._settings.axes), default=0.0)
        return seconds + self._settings.settling_time_s if seconds > 0.0 else 0.0

    def _axis_duration(self, axis: ZaberAxis, start: Mapping[str, float], target: Mapping[str, float]) -> float:
        if axis.name not in target:
            return 0.0
        way = axis.native_from_position(target[axis.name]) - axis.native_from_position(start[axis.name])
        facts = self._chain.axes[axis.name]
        return duration([AxisMotion(float(way), facts.max_rate, facts.acceleration)])
