"""A GenICam camera that takes a frame when told to."""

from __future__ import annotations

import time
from collections.abc import Callable
from threading import Event

from drivers.camera import CameraDescription, Frame
from drivers.clock import LONGEST_NAP
from drivers.errors import DeviceError, DeviceTimeoutError
from drivers.genicam.configuration import Configuration, configure, describe
from drivers.genicam.finding import open_camera
from drivers.genicam.link import GenicamLink, RawFrame
from drivers.genicam.settings import GenicamSettings
from drivers.limits import Limits
from drivers.readback import confirm

FRAME_MARGIN = 1.5
"""Seconds that a frame may take besides its exposure; whether the camera is gone takes 2.5 s more to find out."""

# A camera keeps exposure times in steps, a line of its sensor long where it is coarse.
_EXPOSURE_TIME_TOLERANCE, _COARSEST_STEP = 0.02, 50e-6
_LAST_SHORT_ID = 0xFFFF

OpenCamera = Callable[[str, str | None], GenicamLink]


class GenicamCamera:
    """A camera with USB3 Vision or GigE Vision.

    Parameters
    ----------
    settings : GenicamSettings
    serial_number : str, optional
        Of the one camera allowed; None = the only one there is.
    width, height : int
        Of the region, in pixels.
    open_link : callable
        Takes an address and a serial number; see `drivers.genicam.finding.open_camera`.
    """

    def __init__(
        self,
        settings: GenicamSettings,
        serial_number: str | None,
        width: int,
        height: int,
        open_link: OpenCamera = open_camera,
    ) -> None:
        self._settings, self._serial_number = settings, serial_number
        self._width, self._height = width, height
        self._open_link = open_link
        self._link: GenicamLink | None = None
        self._configuration: Configuration
        self._exposure_time_limits: Limits
        self._stopped = Event()
        self._is_armed = False
        self._last_id: int | None = None
        self._n_triggers = 0

    def connect(self) -> None:
        """Open the camera, set it and compare what it reads back; safe to call twice.

        Raises
        ------
        DriverNotFoundError
            If Aravis or PyGObject is not installed.
        DeviceError
            If it is not there, in use, or does not keep what it is given; then nothing stays open.
        """
        if self._link is not None:
            return
        link = self._open_link(self._settings.address, self._serial_number)
        try:
            self._configuration = configure(link, self._settings, self._width, self._height)
            self._exposure_time_limits = Limits(*link.bounds("exposure_time"), "s")
            link.start()
        except BaseException:
            link.close()
            raise
        self._link, self._is_armed, self._last_id, self._n_triggers = link, True, None, 0

    def disconnect(self) -> None:
        """Close the camera; safe to call twice, and without `connect`."""
        self.stop()
        link, self._link = self._link, None
        if link is not None:
            link.close()

    def describe(self) -> CameraDescription:
        """Return what the connected camera is."""
        return describe(self._connected(), self._settings, self._configuration, self._exposure_time_limits)

    def set_exposure_time(self, exposure_time: float) -> float:
        """Set the exposure time in seconds; return what the camera reads back.

        Raises
        ------
        DeviceLimitError
            If the camera cannot take that exposure time.
        DeviceError
            If it reads back another one.
        """
        link = self._connected()
        # Aravis would wrap what a register cannot hold, without a word.
        remedy = "Drop that step from the bracket or change the aperture."
        self._exposure_time_limits.check("exposure_time", exposure_time, remedy)
        link.set_number("exposure_time", exposure_time)
        read_back = link.number("exposure_time")
        tolerance = max(_COARSEST_STEP, _EXPOSURE_TIME_TOLERANCE * exposure_time)
        confirm("exposure_time", exposure_time, read_back, tolerance, "s")
        return read_back

    def trigger(self) -> Frame:
        """Expose once and return the frame.

        Raises
        ------
        DeviceTimeoutError
            If no frame arrives in time.
        DeviceLostError
            If the camera is gone.
        DeviceError
            If it is stopped, or the frame is incomplete, or not the one of this trigger.
        """
        link = self._connected()
        self._stopped.clear()
        self._make_ready(link)
        exposure_time = link.number("exposure_time")
        # Unless all goes well the next trigger begins anew: what is late for this one must not pass for that one's.
        self._is_armed = False
        number, self._n_triggers = self._n_triggers, self._n_triggers + 1
        link.trigger()
        raw = self._awaited(link, exposure_time)
        counts = self._configuration.pixel_format.counts(raw.data, self._height, self._width)
        frame = Frame(counts, number, exposure_time, link.temperature())
        self._is_armed, self._last_id = True, raw.frame_id
        return frame

    def stop(self) -> None:
        """End any exposure under way; safe to call at any time."""
        # Aravis is left to the thread that waits for the frame: it looks every few hundredths of a second.
        self._stopped.set()

    def _connected(self) -> GenicamLink:
        if self._link is None:
            raise DeviceError("the GenICam camera is not connected. Call connect() first.")
        return self._link

    def _make_ready(self, link: GenicamLink) -> None:
        """Wait for triggers, with no frame waiting that somebody might take for the next one."""
        link.check_presence()
        if not self._is_armed:
            link.start()
            self._last_id = None
        while (left_over := link.frame(0.0)) is not None:
            self._last_id = None if left_over.fault else left_over.frame_id

    def _awaited(self, link: GenicamLink, exposure_time: float) -> RawFrame:
        deadline = time.monotonic() + exposure_time + FRAME_MARGIN
        while (remaining := deadline - time.monotonic()) > 0.0:
            if self._stopped.is_set():
                link.stop()
                raise DeviceError("the exposure was stopped. Trigger again for a frame.")
            raw = link.frame(min(remaining, LONGEST_NAP))
            if raw is not None and raw.fault:
                raise DeviceError(f"the frame is incomplete: {raw.fault}. {_INCOMPLETE}")
            if raw is not None:
                self._check_id(raw.frame_id)
                return raw
        link.check_presence()
        raise DeviceTimeoutError(
            f"no frame arrived within {exposure_time + FRAME_MARGIN:.2f} s of an exposure of {exposure_time:g} s. "
            "Take it again; look at the cable, and at what else is busy in the network"
        )

    def _check_id(self, frame_id: int) -> None:
        """Raise unless the camera counted one frame since the last one; a new stream may begin with any number."""
        last = self._last_id
        # GigE Vision 1 counts 16 bits and leaves 0 out.
        if last is None or frame_id == last + 1 or (last, frame_id) == (_LAST_SHORT_ID, 1):
            return
        raise DeviceError(
            f"the camera's frame is number {frame_id} after {last}: it is not the one of this trigger. Take it again"
        )


_INCOMPLETE = (
    "Take it again; if that happens often: a cable and a port of its own, jumbo frames, "
    "and a larger net.core.rmem_max (docs/devices.md)"
)
