"""A stage on a GRBL 1.1 controller: turntable and tilt, or any goniometer."""

from __future__ import annotations

from collections.abc import Mapping

from drivers.axes.motion import AxisMotion, duration, fastest_rate
from drivers.axes.settings import check_target
from drivers.clock import Clock, RealClock
from drivers.errors import DeviceError, NotHomedError, UnsafeError
from drivers.grbl.codes import bad_state
from drivers.grbl.controller import GrblController
from drivers.grbl.firmware import Firmware
from drivers.grbl.link import FULL_FEED, HOLD, RESTARTED, RESUME, GrblLink
from drivers.grbl.settings import GrblSettings
from drivers.serial_link.port import usb_serial_number
from drivers.stage import StageDescription

_MOVE_MARGIN = 2.0  # seconds that a move may take besides half as long again as its way explains
_STOP_MARGIN = 0.5


class GrblStage:
    """A stage on a GRBL 1.1 controller.

    Positions are the controller's machine positions, taken only while it says that it is idle. It is never unlocked
    by this class: a locked controller has lost its position, and is homed, or unlocked by the operator.

    Parameters
    ----------
    settings : GrblSettings
    clock : Clock, optional
        The computer's if not given.
    """

    def __init__(self, settings: GrblSettings, clock: Clock | None = None) -> None:
        self._settings = settings
        self._controller = GrblController(settings.port, settings.baud_rate, clock or RealClock())
        self._firmware = Firmware({}, "", "", "")

    def connect(self) -> None:
        """Open the port, bring the controller to rest and check its settings; safe to call twice.

        Raises
        ------
        DeviceError
            If the port cannot be opened, something else than GRBL 1.1 answers, or its settings do not fit.
        DeviceTimeoutError
            If nothing answers.
        """
        if self._controller.is_open:
            return
        self._controller.open()
        try:
            self._learn_firmware()
        except BaseException:
            self._controller.close()
            raise

    def disconnect(self) -> None:
        """Stop and close; safe to call twice, and without `connect`."""
        try:
            self.stop()
        finally:
            self._controller.close()

    def describe(self) -> StageDescription:
        """Return what the connected stage is; its serial number is what ``$I=`` stored, else that of its USB plug."""
        port, link = self._settings.port, self._controller.link
        return StageDescription(
            make="GRBL",
            model=link.version,
            serial_number=self._firmware.label or usb_serial_number(port) or port,
            axes=tuple(axis.describe() for axis in self._settings.axes),
            firmware=self._firmware.build,
            settings=tuple(self._firmware.read_back(self._settings.axes)),
        )

    def home(self) -> None:
        """Find the zero of every axis, and go there; a locked controller is free again.

        Raises
        ------
        DeviceError
            If homing fails, or without limit switches if the controller is locked.
        """
        with self._controller.conversation() as link:
            if self._settings.homing:
                self._controller.run_homing(link, self._firmware.homing_limit(self._settings.axes))
            else:
                _refuse_restarted(link)
            self._go(link, self._rest_position(link), {axis.name: 0.0 for axis in self._settings.axes})

    def move(self, target: Mapping[str, float]) -> dict[str, float]:
        """Move the named axes in a straight line, wait until they rest, return every axis' read-back.

        Raises
        ------
        DeviceLimitError
            If an axis does not exist or a target is outside its soft limits; nothing has been sent then.
        DeviceError
            If the controller is locked or raises an alarm, if it was not homed since it was connected, if `stop` was
            called, or if an axis is not where it should be; all rests then.
        UnsafeError
            If it has restarted, or raised an alarm that nobody asked for.
        DeviceTimeoutError
            If the move takes longer than its way and the acceleration explain.
        """
        self._check(target)
        with self._controller.conversation() as link:
            return self._go(link, self._position(link), target)

    def move_duration(self, target: Mapping[str, float]) -> float:
        """Return the seconds that `move` would take from here, settling included; from zero, if it is to be homed yet.

        Raises
        ------
        DeviceLimitError
            If `move` would refuse the target.
        """
        self._check(target)
        with self._controller.conversation() as link:
            report, machine = link.at_rest()
            homeless = report.state == "Alarm" or not self._has_origin(link)
        zero = {axis.name: 0.0 for axis in self._settings.axes}
        return self._duration(zero if homeless else self._named(machine), target)

    def read(self) -> dict[str, float]:
        """Return the position of every axis in degrees or millimetres.

        Raises
        ------
        DeviceError
            If the controller is locked or was not homed since it was connected, so that its position means nothing, or
            if it is beyond its limits.
        UnsafeError
            If it has restarted, or raised an alarm that nobody asked for.
        """
        with self._controller.conversation() as link:
            return self._position(link)

    def stop(self) -> None:
        """Halt every axis now, by deceleration; the position stays known, unless the stage was homing."""
        self._controller.stop()

    def hold(self) -> None:
        """Let a motion under way rest where it is until `resume`; `move` waits."""
        self._controller.link.send(HOLD)

    def resume(self) -> None:
        """Go on after `hold`, or after the hold button of the controller."""
        self._controller.link.send(RESUME)

    def _learn_firmware(self) -> None:
        with self._controller.conversation() as link:
            self._firmware = Firmware.from_lines(link.ask("$$"), link.ask("$I"))
        self._firmware.check(self._settings)
        self._controller.stopping_time = 1.5 * self._firmware.stopping_time(self._settings.axes) + _STOP_MARGIN

    def _go(self, link: GrblLink, start: Mapping[str, float], target: Mapping[str, float]) -> dict[str, float]:
        feed = 60.0 * fastest_rate(self._motions(start, target))
        if feed > 0.0:
            words = self._words(target)
            limit = 1.5 * self._duration(start, target) + _MOVE_MARGIN
            link.send(FULL_FEED)
            # Every mode is said anew, so that none that somebody else left behind changes what is meant. The answer to
            # the dwell comes when the motion has ended, which no report of the state tells as surely.
            self._controller.run(link, f"G21G90G94G53G1{words}F{feed:.1f}")
            self._controller.run(link, f"G4P{self._settings.settling_time_s:.3f}", limit)
        arrived = self._rest_position(link)
        self._check_arrival(target, arrived)
        return arrived

    def _position(self, link: GrblLink) -> dict[str, float]:
        """Return where the stage is, if that can be known, and can be."""
        link.raise_unasked()
        position = self._rest_position(link)
        if not self._has_origin(link):
            raise NotHomedError(
                "the stage was not homed since it was connected: its position is unknown. Home the stage."
            )
        beyond = [
            f"axis {axis.name} is at {position[axis.name]:g}, its limits are {axis.soft_limits[0]:g} and "
            f"{axis.soft_limits[1]:g}"
            for axis in self._settings.axes
            if not axis.soft_limits[0] - axis.tolerance <= position[axis.name] <= axis.soft_limits[1] + axis.tolerance
        ]
        if beyond:
            raise DeviceError(
                f"{'; '.join(beyond)}: it was moved there by hand or counts from elsewhere. Home the stage."
            )
        return position

    def _has_origin(self, link: GrblLink) -> bool:
        return link.homed if self._settings.homing else not link.restarted

    def _rest_position(self, link: GrblLink) -> dict[str, float]:
        report, machine = link.at_rest()
        if report.state != "Idle":
            raise bad_state(report.state)
        return self._named(machine)

    def _named(self, machine: tuple[float, ...]) -> dict[str, float]:
        missing = [axis.letter for axis in self._settings.axes if axis.i_letter >= len(machine)]
        if missing:
            raise DeviceError(f"the controller reports {len(machine)} axes, without {', '.join(missing)}")
        return {axis.name: axis.position_from_native(machine[axis.i_letter]) for axis in self._settings.axes}

    def _check(self, target: Mapping[str, float]) -> None:
        _ = self._controller.link  # before anything is said of the target, there has to be a stage
        check_target(self._settings.axes, target)

    def _words(self, target: Mapping[str, float]) -> str:
        moved = (axis for axis in self._settings.axes if axis.name in target)
        return "".join(f"{axis.letter}{axis.machine_from_position(target[axis.name]):.3f}" for axis in moved)

    def _check_arrival(self, target: Mapping[str, float], arrived: Mapping[str, float]) -> None:
        astray = [
            f"axis {axis.name} is at {arrived[axis.name]:g} instead of {target[axis.name]:g}"
            for axis in self._settings.axes
            if axis.name in target and abs(arrived[axis.name] - target[axis.name]) > axis.tolerance
        ]
        if astray:
            raise DeviceError(f"the stage did not arrive: {'; '.join(astray)}. Home it, then move again.")

    def _duration(self, start: Mapping[str, float], target: Mapping[str, float]) -> float:
        seconds = duration(self._motions(start, target))
        return seconds + self._settings.settling_time_s if seconds > 0.0 else 0.0

    def _motions(self, start: Mapping[str, float], target: Mapping[str, float]) -> list[AxisMotion]:
        return [
            AxisMotion(
                axis.machine_from_position(target[axis.name]) - axis.machine_from_position(start[axis.name]),
                self._firmware.max_rate(axis),
                self._firmware.acceleration(axis),
            )
            for axis in self._settings.axes
            if axis.name in target
        ]


def _refuse_restarted(link: GrblLink) -> None:
    link.forget()
    if link.restarted:
        raise UnsafeError(
            f"{RESTARTED}, and without limit switches it cannot find out. Switch it off, turn the axes to their zero "
            "by hand, switch it on and connect it anew. Poses from here on would be about another origin"
        )
