"""Live frames from a rig, taken in a thread of their own; the light shines only while somebody looks."""

from __future__ import annotations

import time
from collections.abc import Callable
from queue import Empty, SimpleQueue
from threading import Event
from typing import NamedTuple

from PySide6.QtCore import QObject, QThread, Signal

from drivers.camera import Camera, CameraDescription
from drivers.errors import DeviceError
from drivers.light import LightDescription
from drivers.registry import open_devices
from drivers.stage import StageDescription
from gui.rig.light_sign import LightSign
from instrument.config.rig import RigConfig
from instrument.rig.rig import OpenDevices, Rig

FIRST_EXPOSURE_TIME = 0.01
"""Seconds; what the camera is set to when it is opened, or the nearest that it takes."""

LEASE = 2.0
"""Seconds for which the light outlives an exposure, and for which the window may keep silent."""

MIN_PERIOD = 1 / 40
"""Seconds from one frame to the next: a little less than a picture that looks smooth needs, and no more than the cores
can do beside other work."""


class Introduction(NamedTuple):
    """Who the devices of a connected rig are."""

    camera: CameraDescription
    light: LightDescription
    stage: StageDescription


class Acquisition(QThread):
    """Opens a rig, and exposes each time the window says that it has shown the last frame.

    A window that hangs asks for no frame: the light goes out, and on again when the window asks. Its methods may be
    called from any thread.

    Parameters
    ----------
    config : RigConfig
        The rig to open.
    devices : callable, optional
        Makes the devices of `config`.
    parent : QObject, optional
        As in Qt.
    """

    opened = Signal(object)  # Introduction
    frame_arrived = Signal(object)  # Frame; the next one waits for `go_on`
    exposure_time_read = Signal(float)  # seconds, as the camera reads back
    light_changed = Signal(object)  # LightSign
    warned = Signal(str)  # what the operator should know though it goes on
    failed = Signal(str)  # what ended the acquisition

    def __init__(self, config: RigConfig, devices: OpenDevices = open_devices, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self._config = config
        self._devices = devices
        self._orders: SimpleQueue[Callable[[Rig], None] | None] = SimpleQueue()
        self._live = Event()
        self._camera: Camera | None = None
        self._exposure_time = FIRST_EXPOSURE_TIME
        self._last_frame_at = 0.0

    def go_live(self) -> None:
        """Light on, and frames from now on."""
        if not self._live.is_set():
            self._live.set()
            self.go_on()

    def go_on(self) -> None:
        """Take the next frame, if still live."""
        self._orders.put(self._expose)

    def set_exposure_time(self, exposure_time: float) -> None:
        """Set the exposure time in seconds, from the next frame on."""
        self._orders.put(lambda rig: self._set_exposure_time(rig, exposure_time))

    def stop(self) -> None:
        """End the exposure under way and go dark."""
        self._live.clear()
        if self._camera is not None:
            self._camera.stop()
        self._orders.put(self._go_dark)

    def ask_to_leave(self) -> None:
        """Go dark and leave the rig soon; ask again until `finished`.

        A stop that falls just before an exposure does not end it, and orders that come while the rig is being opened
        are dropped.
        """
        self.stop()
        self._orders.put(None)

    def close(self) -> None:
        """Go dark, leave the rig and join the thread."""
        # A trigger blocks for a bounded time, so this ends.
        ended = False
        while not ended:
            self.ask_to_leave()
            ended = self.wait(100)

    def run(self) -> None:
        """Hold the rig open until `close` or an error; Qt calls this in the new thread."""
        self.light_changed.emit(LightSign.UNKNOWN)
        try:
            with Rig.open(self._config, self._devices) as rig:
                self._serve(rig)
        except Exception as error:
            self.failed.emit("\n".join([str(error), *getattr(error, "__notes__", ())]))
        finally:
            self._camera = None

    def _serve(self, rig: Rig) -> None:
        # What was asked of an earlier connection is not meant for this one.
        self._orders = SimpleQueue()
        self._camera = rig.camera
        try:
            self._go_dark(rig)
            self._introduce(rig)
            while (order := self._next_order(rig)) is not None:
                order(rig)
        finally:
            self._go_dark(rig)

    def _introduce(self, rig: Rig) -> None:
        description = rig.camera.describe()
        limits = description.exposure_time_limits
        self._set_exposure_time(rig, min(max(self._exposure_time, limits.low), limits.high))
        self.opened.emit(Introduction(description, rig.light.describe(), rig.stage.describe()))

    def _next_order(self, rig: Rig) -> Callable[[Rig], None] | None:
        try:
            return self._orders.get(timeout=LEASE if self._live.is_set() else None)
        except Empty:
            self._make_safe(rig)
            self.warned.emit(f"the window asked for no frame in {LEASE:g} s, so the light was off meanwhile")
            return self._orders.get()

    def _expose(self, rig: Rig) -> None:
        if not self._live.is_set():
            return
        time.sleep(max(0.0, self._last_frame_at + MIN_PERIOD - time.monotonic()))
        self._last_frame_at = time.monotonic()
        state = rig.light.on(rig.config.light.level, self._exposure_time + LEASE)
        self.light_changed.emit(LightSign.ON if state.lit else LightSign.OFF)
        try:
            self.frame_arrived.emit(rig.camera.trigger())
        except DeviceError:
            # A stop ends the exposure, which the camera reports as an error.
            if self._live.is_set():
                raise

    def _set_exposure_time(self, rig: Rig, exposure_time: float) -> None:
        self._exposure_time = rig.camera.set_exposure_time(exposure_time)
        self.exposure_time_read.emit(self._exposure_time)

    def _go_dark(self, rig: Rig) -> None:
        self._live.clear()
        self._make_safe(rig)

    def _make_safe(self, rig: Rig) -> None:
        """Make the rig safe, and say what is known of the light then."""
        self.light_changed.emit(LightSign.UNKNOWN if rig.safe() else LightSign.OFF)
