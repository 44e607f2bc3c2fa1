"""A rig: enter it ready, leave it dark and stopped."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from threading import Event
from typing import Any

from drivers.camera import Camera
from drivers.clock import Clock, RealClock, sleep_unless
from drivers.errors import CancelledError, DeviceError, NotSafeError, UnsafeError
from drivers.light import Light
from drivers.registry import Devices, open_devices
from drivers.stage import Stage
from instrument.config.rig import RigConfig
from instrument.files.validation import InvalidInputError
from instrument.rig.bounded import BoundedCamera, BoundedLight, BoundedStage, Note
from instrument.rig.lock import hold

_log = logging.getLogger(__name__)

_TOLD_IN_WORDS = (DeviceError, CancelledError, OSError, InvalidInputError, KeyboardInterrupt)
"""Errors of which a user sees the message and no more."""

OpenDevices = Callable[[Mapping[str, Any]], Devices]


def _forget(event: str, **details: object) -> None:
    """Note nothing."""


@dataclass(frozen=True, slots=True)
class Rig:
    """Connected devices and the configuration that they were opened with.

    Attributes
    ----------
    config : RigConfig
    camera, light, stage : Camera, Light, Stage
        Every call of theirs ends in bounded time where the rig was opened by `open` or `connected`.
    clock : Clock
        Whose seconds the devices live by.
    cancel : threading.Event
        Set it from any thread to end every wait on the rig with `CancelledError`.
    """

    config: RigConfig
    camera: Camera
    light: Light
    stage: Stage
    clock: Clock = field(default_factory=RealClock)
    cancel: Event = field(default_factory=Event)

    @classmethod
    @contextmanager
    def open(cls, config: RigConfig, devices: OpenDevices = open_devices) -> Iterator[Rig]:
        """Connect and home the devices; leave them dark, stopped and disconnected.

        Raises
        ------
        DeviceError
            If a device fails to connect or to home, or cannot be made safe on the way out.
        """
        with cls.connected(config, devices) as rig:
            rig.stage.home()
            yield rig

    @classmethod
    @contextmanager
    def connected(
        cls,
        config: RigConfig,
        devices: OpenDevices = open_devices,
        cancel: Event | None = None,
        note: Note = _forget,
    ) -> Iterator[Rig]:
        """Connect all devices or none, without a motion; else as `open`.

        Parameters
        ----------
        config, devices, cancel, note
            As for `held`.

        Raises
        ------
        DeviceError
            With every device that fails to connect, not only the first.
        RigBusyError
            If another process holds the rig.
        """
        with cls.held(config, devices, cancel, note) as rig:
            rig.connect()
            rig.check_serial_numbers(config.serial_numbers)
            with rig._leaving_safe():
                yield rig

    @classmethod
    @contextmanager
    def held(
        cls,
        config: RigConfig,
        devices: OpenDevices = open_devices,
        cancel: Event | None = None,
        note: Note = _forget,
    ) -> Iterator[Rig]:
        """Keep other processes off the rig; connect nothing yet, and disconnect everything on the way out.

        Parameters
        ----------
        config : RigConfig
        devices : callable
            Takes the configuration's tables and returns the devices.
        cancel : threading.Event, optional
            Becomes `Rig.cancel`.
        note : callable, optional
            Takes every command of the light and the stage, and every failure, for the log.

        Raises
        ------
        RigBusyError
            If another process holds the rig.
        """
        with hold(config.name), ExitStack() as stack:
            rig = cls._bounded(config, devices, cancel or Event(), note)
            for device in rig._devices.values():
                stack.callback(_disconnect, device)
            yield rig

    @classmethod
    def _bounded(cls, config: RigConfig, devices: OpenDevices, cancel: Event, note: Note) -> Rig:
        camera, light, stage, clock = Devices(*devices(config.model_dump(exclude_none=True)))
        return cls(
            config,
            BoundedCamera(camera, cancel, note),
            BoundedLight(light, cancel, note),
            BoundedStage(stage, cancel, note),
            clock,
            cancel,
        )

    @property
    def serial_numbers(self) -> dict[str, str]:
        """Serial number of each connected device."""
        return {
            "camera": self.camera.describe().serial_number,
            "light": self.light.describe().serial_number,
            "stage": self.stage.describe().serial_number,
        }

    @property
    def settings(self) -> dict[str, list[str]]:
        """What each connected device holds, as it reads back, in words."""
        return {kind: [str(setting) for setting in d.describe().settings] for kind, d in self._devices.items()}

    @property
    def _devices(self) -> dict[str, Light | Stage | Camera]:
        """By kind, in the order in which they are connected."""
        return {"light": self.light, "stage": self.stage, "camera": self.camera}

    def connect(self) -> None:
        """Open every device.

        Raises
        ------
        DeviceError
            With every one that fails: its own error where it is the only one.
        """
        failures: dict[str, DeviceError] = {}
        for kind, device in self._devices.items():
            try:
                device.connect()
            except DeviceError as error:
                failures[kind] = error
        if failures:
            raise _joined(failures)

    def check_serial_numbers(self, expected: Mapping[str, str]) -> None:
        """Refuse devices that were swapped.

        Parameters
        ----------
        expected : mapping of str to str
            Serial number by kind; a kind that is not named may be any.

        Raises
        ------
        UnsafeError
            Names every device that is another one.
        """
        connected = self.serial_numbers
        swapped = [
            f"the {kind} is {connected[kind]!r} and should be {serial!r}"
            for kind, serial in expected.items()
            if connected[kind] != serial
        ]
        if swapped:
            raise UnsafeError(f"{'; '.join(swapped)}. Connect the devices that the capture began with, or begin anew")

    def reconnect(self, expected: Mapping[str, str]) -> None:
        """Close every device and open it again; see `check_serial_numbers` for `expected`.

        Raises
        ------
        DeviceError
            If one does not come back, or another came in its place.
        """
        for device in reversed(self._devices.values()):
            _disconnect(device)
        self.connect()
        self.check_serial_numbers(expected)

    def wait(self, seconds: float) -> None:
        """Let `seconds` of the rig's clock pass.

        Raises
        ------
        CancelledError
            If `cancel` is set meanwhile.
        """
        if not sleep_unless(self.cancel, self.clock, seconds):
            raise CancelledError("the wait was called off")

    def safe(self) -> tuple[str, ...]:
        """Light off, stage stopped, camera stopped: each is tried, whatever happens to the others.

        Returns
        -------
        tuple of str
            What failed, in words; empty when all is dark and still.
        """
        with _uninterrupted():
            return (
                *_attempt("light off", self._dark),
                *_attempt("stop stage", self.stage.stop),
                *_attempt("stop camera", self.camera.stop),
            )

    def _dark(self) -> None:
        if self.light.off().lit:
            raise DeviceError("the light still reports that it shines; switch it off by hand")

    @contextmanager
    def _leaving_safe(self) -> Iterator[None]:
        try:
            yield
        except BaseException as error:
            failures = self.safe()
            if failures and isinstance(error, _TOLD_IN_WORDS) and not isinstance(error, NotSafeError):
                raise NotSafeError(f"{error or 'interrupted'}. {not_safe(failures)}") from error
            # A traceback shows notes.
            for failure in failures:
                error.add_note(not_safe([failure]))
            raise
        failures = self.safe()
        if failures:
            raise NotSafeError(not_safe(failures))


def not_safe(failures: Sequence[str]) -> str:
    """Say what could not be made safe, for whoever has to look at the rig."""
    return f"NOT SAFE: {'; '.join(failures)}"


def _joined(failures: Mapping[str, DeviceError]) -> DeviceError:
    """Return the one error as it is; several as one, which is unsafe if one of them is."""
    errors = list(failures.values())
    if len(errors) == 1:
        return errors[0]
    worst = UnsafeError if any(isinstance(error, UnsafeError) for error in errors) else DeviceError
    lines = (f"{kind}: {error}" for kind, error in failures.items())
    return worst("\n  ".join([f"{len(errors)} devices cannot be used:", *lines]))


def _attempt(name: str, step: Callable[[], object]) -> Iterator[str]:
    try:
        step()
    except Exception as error:
        yield f"{name} failed: {error}"


def _disconnect(device: Camera | Light | Stage) -> None:
    """Close a device; a failure is logged, for it must not hide what ended the capture."""
    for failure in _attempt("disconnect", device.disconnect):
        _log.warning("%s: %s", type(device).__name__, failure)


@contextmanager
def _uninterrupted() -> Iterator[None]:
    """Hold off Ctrl-C, so that a second one cannot keep the light on."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before or signal.default_int_handler)
