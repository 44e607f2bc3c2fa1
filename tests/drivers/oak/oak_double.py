"""A sensor that the SDK of Luxonis runs on the host: its own pipeline, queues and messages, and no camera behind it."""

from __future__ import annotations

import time
from collections import deque
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from drivers.device_settings import settings_from_table
from drivers.errors import DriverNotFoundError
from drivers.oak.camera import OakCamera
from drivers.oak.connection import Connection, Identity
from drivers.oak.sdk import depthai
from drivers.oak.settings import OakSettings

try:
    SDK = depthai()
except DriverNotFoundError as _error:
    pytest.skip(str(_error), allow_module_level=True)

HEIGHT, WIDTH = 6, 10
_PADDING = 3  # bytes behind each row
_PERIOD = 0.002  # seconds between frames, whatever the exposure is


def settings_of(**changes: Any) -> OakSettings:
    return settings_from_table(OakSettings, {"bayer_pattern": "BGGR", **changes})


def scene(exposure_us: int) -> NDArray[np.uint16]:
    """Return 10-bit counts, shape (HEIGHT, WIDTH): brighter from pixel to pixel, and with the exposure."""
    rate = np.arange(HEIGHT * WIDTH, dtype=np.int64).reshape(HEIGHT, WIDTH)
    return np.minimum(64 + rate * exposure_us // 1000, 1023).astype(np.uint16)


def packed(counts: NDArray[np.uint16], padding: int = _PADDING) -> NDArray[np.uint8]:
    """Return rows as RAW10 goes over a MIPI CSI-2 line, one after the other."""
    rows = bytearray()
    for row in counts.tolist():
        for i in range(0, len(row), 4):
            group = [*row[i : i + 4], 0, 0, 0][:4]
            rows += bytes(count >> 2 for count in group)
            rows.append(sum((count & 3) << 2 * place for place, count in enumerate(group)))
        rows += bytes(padding)
    return np.frombuffer(bytes(rows), np.uint8)


class SensorNode(SDK.node.ThreadedHostNode):
    """What runs in the pipeline; a test sets what goes wrong."""

    def __init__(self) -> None:
        super().__init__()
        self.control = self.createInput()
        self.out = self.createOutput()
        self.delay = 3  # frames until a control acts
        self.line_us = 1  # exposures are whole multiples of it
        self.heeds = True  # controls
        self.is_silent = False
        self.counts_frames = True
        self.packs = True
        self.iso_told: int | None = None
        self.temperature: float | None = None
        self.received: list[Any] = []
        self.exposure_us, self._iso, self._kelvin = 30_000, 100, 5000  # what it is started with
        self._pending: deque[tuple[int, Any]] = deque()

    def run(self) -> None:
        number = 0
        while self.isRunning():
            time.sleep(_PERIOD)
            self._listen(number)
            if not self.is_silent:
                self.out.send(self.frame(number))
            number += self.counts_frames

    def frame(self, number: int) -> Any:
        frame = SDK.ImgFrame()
        counts = scene(self.exposure_us)
        data = packed(counts) if self.packs else counts.view(np.uint8).ravel()
        frame.setType(SDK.ImgFrame.Type.RAW10 if self.packs else SDK.ImgFrame.Type.RAW16)
        frame.setSize(WIDTH, HEIGHT)
        frame.setStride(data.size // HEIGHT)
        frame.setData(data)
        frame.setSequenceNum(number)
        frame.setTimestamp(SDK.Clock.now())
        told = frame.cam
        told.exposureTimeUs, told.wbColorTemp = self.exposure_us, self._kelvin
        told.sensitivityIso = self._iso if self.iso_told is None else self.iso_told
        told.sensorTemperatureC = self.temperature
        frame.cam = told
        return frame

    def _listen(self, number: int) -> None:
        while (control := self.control.tryGet()) is not None:
            self.received.append(control)
            self._pending.append((number + self.delay, control))
        while self._pending and (self._pending[0][0] <= number or not self.counts_frames):
            control = self._pending.popleft()[1]
            if self.heeds:
                lines = round(control.getExposureTime().total_seconds() * 1e6 / self.line_us)
                self.exposure_us = max(1, lines) * self.line_us
                self._iso, self._kelvin = control.getSensitivity(), control.wbColorTemp


class OakDouble:
    """Gives connections to sensors of the host; `sensor` is the latest one, `pipeline` its pipeline."""

    def __init__(self) -> None:
        self.n_closed = 0
        self.faults: dict[str, Any] = {}  # attributes of the next sensor

    def open(self, settings: OakSettings, serial_number: str | None, width: int, height: int) -> Connection:
        assert (width, height) == (WIDTH, HEIGHT)
        self.pipeline = SDK.Pipeline(False)
        self.sensor = self.pipeline.create(SensorNode)
        self.sensor.exposure_us = round(settings.longest_exposure_s * 1e6)
        for name, value in self.faults.items():
            setattr(self.sensor, name, value)
        controls = self.sensor.control.createInputQueue()
        frames = self.sensor.out.createOutputQueue(maxSize=2, blocking=False)
        self.pipeline.start()
        identity = Identity("OAK-1", serial_number or "14442C10D13EABCE00", "depthai 3")
        return Connection(SDK, identity, self.pipeline, controls, frames, self._close)

    def camera(self, **changes: Any) -> OakCamera:
        return OakCamera(settings_of(**changes), None, HEIGHT, WIDTH, self.open)

    def unplug(self) -> None:
        self.pipeline.stop()

    def _close(self) -> None:
        self.n_closed += 1
