"""An open OAK camera: controls go in, raw frames come out.

`open_device` is the one part that needs a camera. It was written from the SDK's documentation and its declarations
and has never met a device; `Connection` below it is tested on a pipeline of the SDK that runs on the host alone.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import dataclass
from datetime import timedelta
from typing import Any

from drivers.errors import DeviceError, DeviceLostError
from drivers.oak.finding import chosen, listed
from drivers.oak.messages import set_controls
from drivers.oak.sdk import depthai, sdk_errors_explained
from drivers.oak.settings import OakSettings

_QUEUE_LENGTH = 2  # frames; older ones give way


@dataclass(frozen=True, slots=True)
class Identity:
    """Which camera it is."""

    model: str
    serial_number: str
    firmware: str


class Connection:
    """A running pipeline.

    Parameters
    ----------
    sdk : module
        depthai.
    identity : Identity
    pipeline : depthai.Pipeline
    controls, frames : depthai.MessageQueue
        Towards the sensor, and from it.
    close_device : callable
        Gives the device back.
    """

    def __init__(
        self,
        sdk: Any,
        identity: Identity,
        pipeline: Any,
        controls: Any,
        frames: Any,
        close_device: Callable[[], None] = lambda: None,
    ) -> None:
        self.sdk, self.identity = sdk, identity
        self._pipeline, self._controls, self._frames = pipeline, controls, frames
        self._close_device = close_device

    def send(self, control: Any) -> None:
        """Send a `depthai.CameraControl`.

        Raises
        ------
        DeviceLostError
            If the camera is gone.
        """
        self._check_running()
        with sdk_errors_explained(self.sdk):
            self._controls.send(control)

    def next_frame(self, seconds: float) -> Any:
        """Return the next `depthai.ImgFrame`; None if none comes within `seconds`.

        Raises
        ------
        DeviceLostError
            If the camera is gone.
        """
        self._check_running()
        with sdk_errors_explained(self.sdk):
            return self._frames.get(timedelta(seconds=seconds))

    def close(self) -> None:
        """End the pipeline and give the device back; safe to call twice, whatever has happened."""
        # A camera that is gone cannot be told to end, and says so in many ways.
        with suppress(Exception):
            self._pipeline.stop()
            # Its threads have to be over before it is forgotten: the SDK joins them while it keeps Python waiting.
            self._pipeline.wait()
        with suppress(Exception):
            self._close_device()

    def _check_running(self) -> None:
        if not self._pipeline.isRunning():
            raise DeviceLostError("the OAK camera is gone. Look at its cable and its power, then connect again")


Opener = Callable[[OakSettings, str | None, int, int], Connection]


def open_device(settings: OakSettings, serial_number: str | None, width: int, height: int) -> Connection:
    """Open the camera that is meant and let its sensor run.

    Raises
    ------
    DriverNotFoundError
        If depthai is not installed.
    DeviceError
        If the camera is not there, may not be opened, or has no such sensor or mode.
    """
    sdk = depthai()
    # Looked for first: the SDK itself waits for twelve seconds where there is none.
    info = chosen(listed(sdk), serial_number)
    with sdk_errors_explained(sdk):
        device = sdk.Device(info)
        try:
            return _running(sdk, device, settings, width, height)
        except BaseException:
            device.close()
            raise


def _running(sdk: Any, device: Any, settings: OakSettings, width: int, height: int) -> Connection:
    # A camera that comes back by itself comes back with other settings.
    device.setMaxReconnectionAttempts(0)
    check_mode(device.getConnectedCameraFeatures(), settings, width, height)
    pipeline = sdk.Pipeline(device)
    socket = getattr(sdk.CameraBoardSocket, settings.socket)
    camera = pipeline.create(sdk.node.Camera).build(socket, (width, height), settings.frame_rate)
    set_controls(sdk, camera.initialControl, settings, settings.longest_exposure_s)
    controls = camera.inputControl.createInputQueue()
    frames = camera.raw.createOutputQueue(maxSize=_QUEUE_LENGTH, blocking=False)
    pipeline.start()
    # What runs on the device is part of the SDK.
    model = device.getProductName() or device.getDeviceName() or "OAK"
    identity = Identity(str(model), str(device.getDeviceId()), f"depthai {sdk.__version__}")
    return Connection(sdk, identity, pipeline, controls, frames, device.close)


def check_mode(features: Iterable[Any], settings: OakSettings, width: int, height: int) -> None:
    """Refuse a sensor that is not there, or that has no such mode.

    Parameters
    ----------
    features : iterable of depthai.CameraFeatures
        One for each sensor.

    Raises
    ------
    DeviceError
        With the sensors or the modes that there are.
    """
    sensors = {feature.socket.name: feature for feature in features}
    if settings.socket not in sensors:
        raise DeviceError(f"the camera has no sensor at {settings.socket}; it has {', '.join(sensors) or 'none'}")
    modes = sensors[settings.socket].configs
    fitting = [mode for mode in modes if (mode.width, mode.height) == (width, height)]
    # An empty list says nothing: some models do not tell their modes.
    if modes and not fitting:
        sizes = dict.fromkeys(f"{mode.width} x {mode.height}" for mode in modes)
        raise DeviceError(
            f"the sensor {settings.socket} has no mode of {width} x {height}; it has {', '.join(sizes)}. "
            "Correct width and height of [camera]"
        )
    slowest = min((mode.minFps for mode in fitting), default=0.0)
    if settings.frame_rate < slowest:
        raise DeviceError(
            f"longest_exposure_s is {settings.longest_exposure_s:g} s, {settings.frame_rate:.3g} frames per second; "
            f"the sensor {settings.socket} has {slowest:.3g} at least. Lower longest_exposure_s"
        )
