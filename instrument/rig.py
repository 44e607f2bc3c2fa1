"""A rig: enter it ready, leave it dark and stopped."""

from __future__ import annotations

import logging
import signal
import threading
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

from drivers.camera import Camera
from drivers.errors import DeviceError
from drivers.light import Light
from drivers.registry import Devices, open_devices
from drivers.stage import Stage
from instrument.rig_config import RigConfig

_log = logging.getLogger(__name__)

OpenDevices = Callable[[Mapping[str, Any]], Devices]


@dataclass(frozen=True, slots=True)
class Rig:
    """Connected devices and the configuration that they were opened with."""

    config: RigConfig
    camera: Camera
    light: Light
    stage: Stage

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
    def connected(cls, config: RigConfig, devices: OpenDevices = open_devices) -> Iterator[Rig]:
        """Connect all devices or none, without a motion; else as `open`."""
        rig = cls(config, *devices(config.model_dump(exclude_none=True)))
        with ExitStack() as stack:
            for device in (rig.light, rig.stage, rig.camera):
                stack.callback(_disconnect, device)
                device.connect()
            with rig._leaving_safe():
                yield rig

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
            # What went wrong first is the message; what safe() met is added to it.
            for failure in self.safe():
                error.add_note(failure)
            raise
        failures = self.safe()
        if failures:
            raise DeviceError(f"the rig could not be made safe: {'; '.join(failures)}")


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
