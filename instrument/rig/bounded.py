"""Puts a time limit on every call of a device; a wait can be cancelled.

A driver may hang where its vendor's library does. Each call runs in a thread of its own, which is given up when
its time is over; the light then goes out by its lease, and `Rig.safe` tries to stop what can still be stopped.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import NoReturn, TypeVar

from drivers.camera import Camera, CameraDescription, Frame
from drivers.clock import LONGEST_NAP
from drivers.errors import CancelledError, DeviceError, DeviceTimeoutError
from drivers.light import Light, LightDescription, LightState
from drivers.stage import Stage, StageDescription

CONNECT_LIMIT = 60.0
"""Seconds to open or close a device; vendors' libraries look for theirs for up to 12 s."""

COMMAND_LIMIT = 5.0
"""Seconds for a command that neither exposes nor moves."""

FRAME_MARGIN = 5.0
"""Seconds that a frame may take besides its exposure: readout, transfer, a busy computer."""

MOVE_MARGIN = 10.0
"""Seconds that a motion may take besides half as long again as the stage itself expects."""

HOME_LIMIT = 180.0
"""Seconds to find every axis' zero from anywhere."""

Result = TypeVar("Result")

Note = Callable[..., None]
"""Takes an event and its details by name, for the log; see `instrument.session.audit`."""


def within(seconds: float, what: str, call: Callable[[], Result], cancel: Event | None = None) -> Result:
    """Return what `call` returns, if it does so in time.

    Parameters
    ----------
    seconds : float
        The limit.
    what : str
        Which device does what, for the message.
    call : callable
        Runs in a thread of its own; an error of it is raised here.
    cancel : threading.Event, optional
        Set by another thread to end the wait; None = the limit alone ends it.

    Raises
    ------
    DeviceTimeoutError
        If it has not returned after `seconds`.
    CancelledError
        If `cancel` is set meanwhile.
    """
    _check_cancel(what, cancel)
    outcome: SimpleQueue[Callable[[], Result]] = SimpleQueue()
    Thread(target=_run, args=(call, outcome), name=what, daemon=True).start()
    deadline = time.monotonic() + seconds
    while True:
        try:
            give = outcome.get(timeout=max(0.0, min(LONGEST_NAP, deadline - time.monotonic())))
        except Empty:
            _check_wait(seconds, deadline, what, cancel)
        else:
            return give()


def _run(call: Callable[[], Result], outcome: SimpleQueue[Callable[[], Result]]) -> None:
    """Put what returns the result of `call`, or raises its error, into `outcome`."""
    try:
        outcome.put(partial(_returned, call()))
    except BaseException as error:
        outcome.put(partial(_raised, error))


def _returned(result: Result) -> Result:
    return result


def _raised(error: BaseException) -> NoReturn:
    raise error


def _check_cancel(what: str, cancel: Event | None) -> None:
    if cancel is not None and cancel.is_set():
        raise CancelledError(f"{what}: called off")


def _check_wait(seconds: float, deadline: float, what: str, cancel: Event | None) -> None:
    _check_cancel(what, cancel)
    if time.monotonic() >= deadline:
        raise DeviceTimeoutError(
            f"{what} did not end within {seconds:g} s. Look whether the device is alive; it is connected anew"
        )


class _Bounded:
    """What the three have in common: limits, a way to be called off, and a log of what failed."""

    def __init__(self, kind: str, cancel: Event, note: Note) -> None:
        self._kind, self._cancel, self._note = kind, cancel, note

    def _do(self, seconds: float, what: str, call: Callable[[], Result]) -> Result:
        return self._noted(seconds, what, call, self._cancel)

    def _do_whatever_happens(self, seconds: float, what: str, call: Callable[[], Result]) -> Result:
        """Return what `call` returns; nobody can call this off."""
        return self._noted(seconds, what, call, None)

    def _noted(self, seconds: float, what: str, call: Callable[[], Result], cancel: Event | None) -> Result:
        try:
            return within(seconds, f"{self._kind}: {what}", call, cancel)
        except DeviceError as error:
            self._note("device failed", device=self._kind, what=what, why=str(error))
            raise


class BoundedCamera(_Bounded):
    """A camera whose calls end; see `within`."""

    def __init__(self, camera: Camera, cancel: Event, note: Note) -> None:
        super().__init__("camera", cancel, note)
        self._camera = camera
        self._exposure_time = 0.0

    def connect(self) -> None:
        """Open the device; safe to call twice."""
        self._do(CONNECT_LIMIT, "connect", self._camera.connect)

    def disconnect(self) -> None:
        """Close the device; safe to call twice, and without `connect`."""
        self._do_whatever_happens(CONNECT_LIMIT, "disconnect", self._camera.disconnect)

    def describe(self) -> CameraDescription:
        """Return what the connected camera is."""
        return self._do(COMMAND_LIMIT, "describe", self._camera.describe)

    def set_exposure_time(self, exposure_time: float) -> float:
        """Set the exposure time in seconds; return what the camera reads back."""
        self._exposure_time = exposure_time
        return self._do(COMMAND_LIMIT, "set the exposure time", lambda: self._camera.set_exposure_time(exposure_time))

    def trigger(self) -> Frame:
        """Expose once and return the frame."""
        return self._do(self._exposure_time + FRAME_MARGIN, "take a frame", self._camera.trigger)

    def stop(self) -> None:
        """End any exposure under way."""
        self._do_whatever_happens(COMMAND_LIMIT, "stop", self._camera.stop)


class BoundedLight(_Bounded):
    """A light whose calls end, and of which every command is noted; see `within`."""

    def __init__(self, light: Light, cancel: Event, note: Note) -> None:
        super().__init__("light", cancel, note)
        self._light = light

    def connect(self) -> None:
        """Open the device, dark; safe to call twice."""
        self._do(CONNECT_LIMIT, "connect", self._light.connect)

    def disconnect(self) -> None:
        """Switch off and close; safe to call twice, and without `connect`."""
        self._do_whatever_happens(CONNECT_LIMIT, "disconnect", self._light.disconnect)

    def describe(self) -> LightDescription:
        """Return what the connected light is."""
        return self._do(COMMAND_LIMIT, "describe", self._light.describe)

    def on(self, level: float, max_seconds: float) -> LightState:
        """Shine at `level` for at most `max_seconds`, then go dark unless told again."""
        # Before the command: if all ends with it, the log still says what was meant to shine.
        self._note("light on", level=level, max_seconds=max_seconds)
        return self._do(COMMAND_LIMIT, "on", lambda: self._light.on(level, max_seconds))

    def off(self) -> LightState:
        """Go dark and confirm it."""
        state = self._do_whatever_happens(COMMAND_LIMIT, "off", self._light.off)
        self._note("light off", lit=state.lit)
        return state

    def read(self) -> LightState:
        """Return the state as the device reports it."""
        return self._do(COMMAND_LIMIT, "read", self._light.read)


class BoundedStage(_Bounded):
    """A stage whose calls end, and of which every motion is noted; see `within`."""

    def __init__(self, stage: Stage, cancel: Event, note: Note) -> None:
        super().__init__("stage", cancel, note)
        self._stage = stage

    def connect(self) -> None:
        """Open the device, at rest; safe to call twice."""
        self._do(CONNECT_LIMIT, "connect", self._stage.connect)

    def disconnect(self) -> None:
        """Stop and close; safe to call twice, and without `connect`."""
        self._do_whatever_happens(CONNECT_LIMIT, "disconnect", self._stage.disconnect)

    def describe(self) -> StageDescription:
        """Return what the connected stage is."""
        return self._do(COMMAND_LIMIT, "describe", self._stage.describe)

    def home(self) -> None:
        """Find the zero of every axis."""
        self._note("home")
        self._do(HOME_LIMIT, "home", self._stage.home)

    def move(self, target: Mapping[str, float]) -> dict[str, float]:
        """Move the named axes, wait until they rest, return every axis' read-back."""
        self._note("move", **target)
        limit = 1.5 * self.move_duration(target) + MOVE_MARGIN
        return self._do(limit, "move", lambda: self._stage.move(target))

    def move_duration(self, target: Mapping[str, float]) -> float:
        """Return the seconds that `move` would take from here, settling included."""
        return self._do(COMMAND_LIMIT, "estimate a motion", lambda: self._stage.move_duration(target))

    def read(self) -> dict[str, float]:
        """Return the position of every axis as the device reports it."""
        return self._do(COMMAND_LIMIT, "read", self._stage.read)

    def stop(self) -> None:
        """Halt every axis now."""
        self._do_whatever_happens(COMMAND_LIMIT, "stop", self._stage.stop)
