"""The simulated stage: a turntable that rides on a tilting arm."""

from __future__ import annotations

from collections.abc import Mapping
from threading import Event

from drivers.clock import LONGEST_NAP, sleep_unless
from drivers.errors import DeviceError, DeviceLimitError
from drivers.limits import Limits
from drivers.simulated.world import World
from drivers.stage import AxisDescription, StageDescription

_SPEED = 20.0  # degrees per second, every axis at once
_SETTLING_TIME = 0.2  # seconds
_DECIMALS = 3  # of the encoders, in degrees

_AXES = (
    AxisDescription("tilt", "rotation", Limits(-65.0, 65.0, "deg"), 0.01, (1.0, 0.0, 0.0)),
    AxisDescription("turn", "rotation", Limits(-360.0, 360.0, "deg"), 0.01, (0.0, 0.0, 1.0)),
)


class SimulatedStage:
    """A stage that moves the sample of a simulated world.

    Parameters
    ----------
    world : World
        Shared with the camera and the light.
    """

    def __init__(self, world: World) -> None:
        self._world = world
        self._connected = False
        self._stopped = Event()

    def connect(self) -> None:
        """Open the device, at rest; safe to call twice."""
        self._connected = True

    def disconnect(self) -> None:
        """Stop and close; safe to call twice, and without `connect`."""
        self.stop()
        self._connected = False

    def describe(self) -> StageDescription:
        """Return what the stage is."""
        self._require_connection()
        seed = self._world.bench.simulation.seed
        return StageDescription("halfangle", "simulated stage", f"sim-{seed}", _AXES)

    def home(self) -> None:
        """Find the zero of every axis, and stay there."""
        self.move({axis.name: 0.0 for axis in _AXES})

    def move(self, target: Mapping[str, float]) -> dict[str, float]:
        """Move the named axes, wait until they rest, return every axis' read-back.

        Raises
        ------
        DeviceLimitError
            If an axis does not exist or a target is outside its soft limits; nothing has moved then.
        DeviceError
            If `stop` was called meanwhile.
        """
        self._require_connection()
        self._check(target)
        self._stopped.clear()
        self._world.n_arrivals += 1
        start, end = self.read(), {**self.read(), **_as_encoded(target)}
        if not self._travel(start, end):
            raise DeviceError(
                f"the move to {_text(end)} was stopped at {_text(self.read())}. Find out why, then move again."
            )
        return self.read()

    def move_duration(self, target: Mapping[str, float]) -> float:
        """Return the seconds that `move` would take from here, settling included.

        Raises
        ------
        DeviceLimitError
            If `move` would refuse the target.
        """
        self._require_connection()
        self._check(target)
        return _duration(self.read(), {**self.read(), **_as_encoded(target)})

    def read(self) -> dict[str, float]:
        """Return the position of every axis in degrees."""
        self._require_connection()
        return dict(self._world.position)

    def stop(self) -> None:
        """Halt every axis now; safe to call at any time."""
        self._stopped.set()

    def _require_connection(self) -> None:
        if not self._connected:
            raise DeviceError("the simulated stage is not connected. Call connect() first.")

    def _check(self, target: Mapping[str, float]) -> None:
        limits = {axis.name: axis.soft_limits for axis in _AXES}
        for name, value in target.items():
            if name not in limits:
                raise DeviceLimitError(f"the stage has no axis {name!r}; its axes are {', '.join(limits)}")
            limits[name].check(f"target of axis {name}", value, "Leave that pose out of the plan.")

    def _travel(self, start: Mapping[str, float], end: Mapping[str, float]) -> bool:
        """Go from `start` to `end`; return False if stopped on the way."""
        clock, began, duration = self._world.clock, self._world.clock.now(), _duration(start, end)
        arrival = began + max(0.0, duration - _SETTLING_TIME)
        while (now := clock.now()) < arrival:
            self._world.position = _between(start, end, (now - began) / (arrival - began))
            if not sleep_unless(self._stopped, clock, min(LONGEST_NAP, arrival - now)):
                return False
        self._world.position = dict(end)
        return sleep_unless(self._stopped, clock, began + duration - clock.now())


def _as_encoded(target: Mapping[str, float]) -> dict[str, float]:
    # Adding 0 turns -0 into 0, which reads better.
    return {name: round(float(value), _DECIMALS) + 0.0 for name, value in target.items()}


def _between(start: Mapping[str, float], end: Mapping[str, float], share: float) -> dict[str, float]:
    return _as_encoded({name: start[name] + share * (end[name] - start[name]) for name in start})


def _duration(start: Mapping[str, float], end: Mapping[str, float]) -> float:
    way = max(abs(end[name] - start[name]) for name in start)
    return way / _SPEED + _SETTLING_TIME if way > 0.0 else 0.0


def _text(position: Mapping[str, float]) -> str:
    return ", ".join(f"{name} {value:g} deg" for name, value in position.items())
