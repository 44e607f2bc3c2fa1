"""A Luxonis OAK as a camera that takes one raw frame when told to.

The sensor runs all the time. A frame counts as triggered if its exposure began after the call, and if it tells the
exposure time and the sensitivity that were asked for; every other one is passed over.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from drivers.camera import CameraDescription, Frame
from drivers.clock import LONGEST_NAP, Clock, RealClock
from drivers.errors import DeviceError, DeviceLostError, DeviceTimeoutError
from drivers.oak.connection import Connection, Opener, open_device
from drivers.oak.messages import FrameFacts, counts, now, set_controls
from drivers.oak.settings import OakSettings
from drivers.readback import Setting, confirm

_TICK = 1e-6  # seconds: exposure times are whole ones
_OTHER_FRAMES = 10  # after which a camera that tells other values than were asked for is believed
_SETTLING_LIMIT = 4.0  # seconds; a command has five
_FRAME_MARGIN = 2.0  # seconds that a frame may take besides two at full length


class OakCamera:
    """One sensor of a Luxonis OAK.

    Parameters
    ----------
    settings : OakSettings
    serial_number : str or None
        Of the one camera allowed; None = the only one that is attached.
    height, width : int
        Pixels of a raw frame.
    open_connection : callable, optional
        What gives the connection.
    clock : Clock, optional
        Whose seconds the limits are counted by; the computer's if not given.
    """

    def __init__(
        self,
        settings: OakSettings,
        serial_number: str | None,
        height: int,
        width: int,
        open_connection: Opener = open_device,
        clock: Clock | None = None,
    ) -> None:
        self._settings, self._serial_number = settings, serial_number
        self._height, self._width = height, width
        self._open_connection = open_connection
        self._clock = clock or RealClock()
        self._connection: Connection | None = None
        self._exposure_time = settings.longest_exposure_s
        self._told = float("nan")  # exposure time of the last frame, seconds
        self._white_balance_k = 0
        self._n_triggers, self._n_stops, self._last_number = 0, 0, -1

    def connect(self) -> None:
        """Open the camera and wait until it tells what it was set to; safe to call twice.

        Raises
        ------
        DriverNotFoundError
            If depthai is not installed.
        DeviceError
            If the camera is not there, may not be opened, or does not take its settings.
        """
        if self._connection is not None:
            return
        self._connection = self._open_connection(self._settings, self._serial_number, self._width, self._height)
        self._n_triggers, self._last_number, self._told = 0, -1, float("nan")
        try:
            # What its sensor was started with.
            self.set_exposure_time(self._settings.longest_exposure_s)
        except BaseException:
            self._close()
            raise

    def disconnect(self) -> None:
        """Close the camera; safe to call twice, and without `connect`."""
        self.stop()
        self._close()

    def describe(self) -> CameraDescription:
        """Return what the connected camera is."""
        settings = self._settings
        with self._open() as connection:
            identity = connection.identity
        return CameraDescription(
            make="Luxonis",
            model=identity.model,
            serial_number=identity.serial_number,
            height=self._height,
            width=self._width,
            bit_depth=settings.bit_depth,
            black_level=settings.black_level,
            saturation_level=settings.clipping_count,
            bayer_pattern=settings.bayer_pattern,
            conversion_gain=float("nan") if settings.conversion_gain is None else settings.conversion_gain,
            read_noise=float("nan") if settings.read_noise is None else settings.read_noise,
            exposure_time_limits=settings.exposure_time_limits,
            firmware=identity.firmware,
            settings=self._read_back(),
        )

    def set_exposure_time(self, exposure_time: float) -> float:
        """Set the exposure time in seconds; return what the frames tell once it holds.

        Raises
        ------
        DeviceLimitError
            If the camera cannot take that exposure time.
        DeviceError
            If the frames go on telling another exposure time, or another sensitivity.
        """
        with self._open() as connection:
            remedy = "Drop that step from the bracket, change the aperture, or see longest_exposure_s of the camera."
            self._settings.exposure_time_limits.check("exposure_time", exposure_time, remedy)
            asked = round(exposure_time / _TICK) * _TICK
            since = now(connection.sdk)
            connection.send(set_controls(connection.sdk, connection.sdk.CameraControl(), self._settings, asked))
            _, facts = self._frame(connection, since, asked, _SETTLING_LIMIT, self._told)
        # A sensor exposes whole lines; what it made of the time is told, and what is far off is no answer to it.
        confirm("exposure_time", asked, facts.exposure_time, max(0.02 * asked, 5e-5), "s")
        confirm("iso", self._settings.iso, facts.iso, 0.0, "ISO")
        self._exposure_time, self._white_balance_k = facts.exposure_time, facts.white_balance_k
        return self._exposure_time

    def trigger(self) -> Frame:
        """Take the next frame whose exposure begins after this call, and return it.

        Raises
        ------
        DeviceError
            If frames come with another exposure time or sensitivity, in another format, or if `stop` was called.
        DeviceTimeoutError
            If no such frame comes in time.
        """
        limit = 2.0 / self._settings.frame_rate + self._exposure_time + _FRAME_MARGIN
        with self._open() as connection:
            message, facts = self._frame(connection, now(connection.sdk), self._exposure_time, limit)
        confirm("exposure_time", self._exposure_time, facts.exposure_time, 0.5 * _TICK, "s")
        confirm("iso", self._settings.iso, facts.iso, 0.0, "ISO")
        frame = Frame(
            counts(message, self._height, self._width, self._settings.bit_depth),
            self._n_triggers,
            self._exposure_time,
            facts.sensor_temperature,
        )
        self._n_triggers += 1
        return frame

    def stop(self) -> None:
        """End the wait for a frame; safe to call at any time."""
        self._n_stops += 1

    @contextmanager
    def _open(self) -> Iterator[Connection]:
        """Have the connection; a camera that is gone is closed, so that it can be opened again."""
        if self._connection is None:
            raise DeviceError("the OAK camera is not connected. Call connect() first.")
        try:
            yield self._connection
        except DeviceLostError:
            self._close()
            raise

    def _close(self) -> None:
        connection, self._connection = self._connection, None
        if connection is not None:
            connection.close()

    def _frame(
        self,
        connection: Connection,
        since: float,
        exposure_time: float,
        seconds: float,
        exposure_before: float = float("nan"),
    ) -> tuple[Any, FrameFacts]:
        """Return the first frame that began after `since` and tells this exposure time, or else the last one.

        A frame that tells the exposure before only shows that a control has not arrived yet.
        """
        n_stops, deadline = self._n_stops, self._clock.now() + seconds
        found, n_others = None, 0
        while n_others < _OTHER_FRAMES and self._clock.now() < deadline:
            message = connection.next_frame(LONGEST_NAP)
            if self._n_stops != n_stops:
                raise DeviceError("the exposure was stopped. Trigger again for a frame.")
            if message is None:
                continue
            facts = FrameFacts.of(connection.sdk, message)
            # A frame that was begun before, or that came once already, shows another scene than is meant.
            if facts.began < since or facts.sequence_number <= self._last_number:
                continue
            found = (message, facts)
            if self._tells(facts, exposure_time):
                break
            n_others += facts.exposure_time != exposure_before
        if found is None:
            raise DeviceTimeoutError(
                f"no new frame of the OAK camera within {seconds:.1f} s. Look at its cable; then connect again"
            )
        self._last_number, self._told = found[1].sequence_number, found[1].exposure_time
        return found

    def _tells(self, facts: FrameFacts, exposure_time: float) -> bool:
        return abs(facts.exposure_time - exposure_time) < 0.5 * _TICK and facts.iso == self._settings.iso

    def _read_back(self) -> tuple[Setting, ...]:
        return (
            Setting("iso", float(self._settings.iso), "ISO"),
            Setting("white_balance", float(self._white_balance_k), "K"),
            Setting("frame_rate", self._settings.frame_rate, "Hz"),
        )
