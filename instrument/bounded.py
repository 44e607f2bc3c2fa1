"""Devices whose every call ends: in time, with an error, or when somebody calls the wait off.

A driver may hang where its vendor's library does. Each call runs in a thread of its own, which is given up when
its time is over; the light then goes out by its lease, and `Rig.safe` tries to stop what can still be stopped.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from queue import Empty, SimpleQueue
from threading import Event, Thread
from typing import TypeVar

from drivers.camera import Camera, CameraDescription, Frame
from drivers.clock import LONGEST_NAP
from drivers.errors import CancelledError, DeviceTimeoutError
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
    outcome: SimpleQueue[tuple[Result | None, BaseException | None]] = SimpleQueue()
    Thread(target=_run, args=(call, outcome), name=what, daemon=True).start()
    deadline = time.monotonic() + seconds
    while True:
        try:
            result, error = outcome.get(timeout=max(0.0, min(LONGEST_NAP, deadline - time.monotonic())))
        except Empty:
            _check_wait(seconds, deadline, what, cancel)
            continue
        if error is not None:
            raise error
        return result  # type: ignore[return-value]


def _run(call: Callable[[], Result], outcome: SimpleQueue[tuple[Result | None, BaseException | None]]) -> None:
    try:
        outcome.put((call(), None))
    except BaseException as error:
        outcome.put((None, error))


def _check_wait(seconds: float, deadline: float, what: str, cancel: Event | None) -> None:
    if cancel is not None and cancel.is_set():
        raise CancelledError(f"{what}: called off")
    if time.monotonic() >= deadline:
        raise DeviceTimeoutError(
            f"{what} did not end within {seconds:g} s. Look whether the device is alive; it is connected anew"
        )


class BoundedCamera:
    """A camera whose calls end; see `within`."""

    def __init__(self, camera: Camera, cancel: Event) -> None:
        self._camera, self._cancel = camera, cancel
        self._exposure_time = 0.0

    def connect(self) -> None:
        """Open the device; safe to call twice."""
        within(CONNECT_LIMIT, "camera: connect", self._camera.connect, self._cancel)

    def disconnect(self) -> None:
        """Close the device; safe to call twice, and without `connect`."""
        within(CONNECT_LIMIT, "camera: disconnect", self._camera.disconnect)

    def describe(self) -> CameraDescription:
        """Return what the connected camera is."""
        return within(COMMAND_LIMIT, "camera: describe", self._camera.describe, self._cancel)

    def set_exposure_time(self, exposure_time: float) -> float:
        """Set the exposure time in seconds; return what the camera reads back."""
        what = "camera: set the exposure time"
        read_back = within(COMMAND_LIMIT, what, lambda: self._camera.set_exposure_time(exposure_time), self._cancel)
        self._exposure_time = exposure_time
        return read_back

    def trigger(self) -> Frame:
        """Expose once and return the frame."""
        limit = self._exposure_time + FRAME_MARGIN
        return within(limit, "camera: the frame", self._camera.trigger, self._cancel)

    def stop(self) -> None:
        """End any exposure under way."""
        within(COMMAND_LIMIT, "camera: stop", self._camera.stop)


class BoundedLight:
    """A light whose calls end; see `within`."""

    def __init__(self, light: Light, cancel: Event) -> None:
        self._light, self._cancel = light, cancel

    def connect(self) -> None:
        """Open the device, dark; safe to call twice."""
        within(CONNECT_LIMIT, "light: connect", self._light.connect, self._cancel)

    def disconnect(self) -> None:
        """Switch off and close; safe to call twice, and without `connect`."""
        within(CONNECT_LIMIT, "light: disconnect", self._light.disconnect)

    def describe(self) -> LightDescription:
        """Return what the connected light is."""
        return within(COMMAND_LIMIT, "light: describe", self._light.describe, self._cancel)

    def on(self, level: float, max_seconds: float) -> LightState:
        """Shine at `level` for at most `max_seconds`, then go dark unless told again."""
        return within(COMMAND_LIMIT, "light: on", lambda: self._light.on(level, max_seconds), self._cancel)

    def off(self) -> LightState:
        """Go dark and confirm it; nothing calls this off."""
        return within(COMMAND_LIMIT, "light: off", self._light.off)

    def read(self) -> LightState:
        """Return the state as the device reports it."""
        return within(COMMAND_LIMIT, "light: read", self._light.read, self._cancel)


class BoundedStage:
    """A stage whose calls end; see `within`."""

    def __init__(self, stage: Stage, cancel: Event) -> None:
        self._stage, self._cancel = stage, cancel

    def connect(self) -> None:
        """Open the device, at rest; safe to call twice."""
        within(CONNECT_LIMIT, "stage: connect", self._stage.connect, self._cancel)

    def disconnect(self) -> None:
        """Stop and close; safe to call twice, and without `connect`."""
        within(CONNECT_LIMIT, "stage: disconnect", self._stage.disconnect)

    def describe(self) -> StageDescription:
        """Return what the connected stage is."""
        return within(COMMAND_LIMIT, "stage: describe", self._stage.describe, self._cancel)

    def home(self) -> None:
        """Find the zero of every axis."""
        within(HOME_LIMIT, "stage: home", self._stage.home, self._cancel)

    def move(self, target: Mapping[str, float]) -> dict[str, float]:
        """Move the named axes, wait until they rest, return every axis' read-back."""
        limit = 1.5 * self.move_duration(target) + MOVE_MARGIN
        return within(limit, "stage: the motion", lambda: self._stage.move(target), self._cancel)

    def move_duration(self, target: Mapping[str, float]) -> float:
        """Return the seconds that `move` would take from here, settling included."""
        return within(
            COMMAND_LIMIT, "stage: estimate a motion", lambda: self._stage.move_duration(target), self._cancel
        )

    def read(self) -> dict[str, float]:
        """Return the position of every axis as the device reports it."""
        return within(COMMAND_LIMIT, "stage: read", self._stage.read, self._cancel)

    def stop(self) -> None:
        """Halt every axis now."""
        within(COMMAND_LIMIT, "stage: stop", self._stage.stop)
