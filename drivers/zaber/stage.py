"""A stage of Zaber's devices: turntable and tilt, or any goniometer."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager

from drivers.axes.settings import check_target
from drivers.clock import Clock, RealClock
from drivers.errors import DeviceError, DeviceLostError
from drivers.stage import StageDescription
from drivers.zaber.devices import read_chain
from drivers.zaber.drive import ZaberDrive
from drivers.zaber.flags import is_blocking, noted
from drivers.zaber.link import ZaberLink
from drivers.zaber.settings import ZaberSettings

_MOVE_MARGIN = 2.0  # seconds that a move may take besides half as long again as its way explains


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
        self._drive: ZaberDrive | None = None

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
        if self._drive is not None:
            return
        link = ZaberLink(self._settings.port, self._settings.baud_rate)
        try:
            drive = ZaberDrive(link, read_chain(link, self._settings), self._settings, self._clock)
            drive.halt()
        except BaseException:
            link.close()
            raise
        self._drive = drive

    def disconnect(self) -> None:
        """Stop and close; safe to call twice, and without `connect`."""
        try:
            self.stop()
        finally:
            self._close()

    def describe(self) -> StageDescription:
        """Return what the connected stage is; several devices are joined by ``+``."""
        with self._open() as drive:
            chain = drive.chain
        return StageDescription(
            make="Zaber",
            model=f"device id {'+'.join(chain.device_ids)}",
            serial_number="+".join(chain.serial_numbers),
            axes=tuple(axis.describe() for axis in self._settings.axes),
            firmware="+".join(chain.firmware),
            settings=chain.settings(self._settings.axes),
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
        with self._open() as drive:
            n_stops, axes = drive.n_stops, self._settings.axes
            for axis in axes:
                drive.link.ask("warnings clear", *axis.place)
            limit = max(drive.chain.axes[axis.name].homing_limit for axis in axes)
            drive.run(dict.fromkeys(axes, "home"), limit, n_stops)
            self._go(drive, {axis.name: 0.0 for axis in axes}, n_stops)

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
        with self._open() as drive:
            n_stops = drive.n_stops
            check_target(self._settings.axes, target)
            return self._go(drive, target, n_stops)

    def move_duration(self, target: Mapping[str, float]) -> float:
        """Return the seconds that `move` would take from here, settling included; from zero, if it is to be homed yet.

        Raises
        ------
        DeviceLimitError
            If `move` would refuse the target.
        """
        with self._open() as drive:
            check_target(self._settings.axes, target)
            position, flags = drive.look()
            homeless = any(is_blocking(flag) for axis_flags in flags.values() for flag in axis_flags)
            return drive.duration(dict.fromkeys(position, 0.0) if homeless else position, target)

    def read(self) -> dict[str, float]:
        """Return the position of every axis in degrees or millimetres.

        Raises
        ------
        DeviceError
            If an axis has a fault or no reference, so that its position means nothing.
        """
        with self._open() as drive:
            return drive.position()

    def stop(self) -> None:
        """Halt every axis now, by deceleration; whoever waits for a move is told."""
        if self._drive is not None:
            with self._open() as drive:
                drive.stop()

    def _close(self) -> None:
        drive, self._drive = self._drive, None
        if drive is not None:
            drive.link.close()

    @contextmanager
    def _open(self) -> Iterator[ZaberDrive]:
        """Have the axes; a port that is gone is closed, so that it can be opened again."""
        drive = self._drive
        if drive is None:
            raise DeviceError("the Zaber stage is not connected. Call connect() first.")
        try:
            yield drive
        except DeviceLostError:
            self._close()
            raise

    def _go(self, drive: ZaberDrive, target: Mapping[str, float], n_stops: int) -> dict[str, float]:
        seconds = drive.duration(drive.position(), target)
        if seconds > 0.0:
            moved = [axis for axis in self._settings.axes if axis.name in target]
            commands = {axis: f"move abs {axis.native_from_position(target[axis.name])}" for axis in moved}
            drive.run(commands, 1.5 * seconds + _MOVE_MARGIN, n_stops)
            self._clock.sleep(self._settings.settling_time_s)
        arrived = drive.position()
        self._check_arrival(drive, target, arrived)
        return arrived

    def _check_arrival(self, drive: ZaberDrive, target: Mapping[str, float], arrived: Mapping[str, float]) -> None:
        axes = [axis for axis in self._settings.axes if axis.name in target]
        astray = [axis for axis in axes if abs(arrived[axis.name] - target[axis.name]) > axis.tolerance]
        if astray:
            _, flags = drive.look()
            texts = [
                f"axis {axis.name} is at {arrived[axis.name]:g} instead of {target[axis.name]:g} "
                f"(flags: {noted(flags[axis.name]) or 'none'})"
                for axis in astray
            ]
            raise DeviceError(f"the stage did not arrive: {'; '.join(texts)}. Home it, then move again.")
