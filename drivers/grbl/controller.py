"""An open GRBL controller: one conversation at a time, and at rest whenever one fails."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from threading import Event, Lock

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceLostError, DeviceTimeoutError
from drivers.grbl.link import HOLD, JOG_CANCEL, RESET, GrblLink
from drivers.serial_link.port import SerialPort

# Seconds. A board that the opening of its port restarts takes two of them to greet.
_GREETING_LIMIT, _RESET_LIMIT = 6.0, 2.0
_TURN_LIMIT = 4.0  # for another thread to end what it does
_POLL = 0.02  # after which a waiting call looks whether it was stopped
_REPORT_LIMIT = 0.5  # a controller that waits for a reset reports nothing


class GrblController:
    """The controller at a port; open it first.

    Parameters
    ----------
    port : str
        Name of the port.
    baud_rate : int
    clock : Clock
        Whose seconds the limits are counted by.

    Attributes
    ----------
    stopping_time : float
        Seconds within which it comes to rest; before it has told its acceleration, a guess.
    """

    def __init__(self, port: str, baud_rate: int, clock: Clock) -> None:
        self._name, self._baud_rate, self._clock = port, baud_rate, clock
        self._turn = Lock()
        self._stopped = Event()
        self._homing = Event()
        self._port: SerialPort | None = None
        self._link: GrblLink | None = None
        self.stopping_time = 3.0

    @property
    def is_open(self) -> bool:
        """Whether there is a port to talk to."""
        return self._link is not None

    @property
    def link(self) -> GrblLink:
        """The conversation; characters that act at once need no `conversation`.

        Raises
        ------
        DeviceError
            If it is not open.
        """
        if self._link is None:
            raise DeviceError("the GRBL stage is not connected. Call connect() first.")
        return self._link

    def open(self) -> None:
        """Open the port and bring the controller to rest.

        Raises
        ------
        DeviceError
            If the port cannot be opened, or something else than GRBL 1.1 answers.
        DeviceTimeoutError
            If nothing answers.
        """
        self._port = SerialPort(self._name, self._baud_rate, _POLL)
        try:
            link = GrblLink(self._port, self._clock)
            self._bring_to_rest(link, _GREETING_LIMIT)
        except BaseException:
            self.close()
            raise
        self._link = link

    def close(self) -> None:
        """Give the port back; safe to call twice."""
        port, self._port, self._link = self._port, None, None
        if port is not None:
            port.close()

    @contextmanager
    def conversation(self) -> Iterator[GrblLink]:
        """Have the link alone, and in step with the controller."""
        with self._exclusive() as link:
            if not link.in_step:
                self._bring_to_rest(link, _RESET_LIMIT)
            yield link

    def run(self, link: GrblLink, line: str, seconds: float | None = None) -> None:
        """Let a line move axes until it is answered; whatever fails, all rests then.

        Parameters
        ----------
        link : GrblLink
            Of a `conversation`.
        line : str
        seconds : float, optional
            The limit, if the answer takes longer than usual.
        """
        try:
            link.ask(line, seconds, self._stopped)
        except DeviceLostError:
            raise
        except DeviceError:
            # What failed first is the message.
            with suppress(DeviceError):
                self._bring_to_rest(link, _RESET_LIMIT)
            raise

    def run_homing(self, link: GrblLink, seconds: float) -> None:
        """Let the limit switches be found."""
        self._homing.set()
        try:
            self.run(link, "$H", seconds)
            link.know_origin()
        finally:
            self._homing.clear()

    def stop(self) -> None:
        """Halt every axis now, whoever waits for an answer; nothing if it is not open."""
        if self._link is None:
            return
        self._stopped.set()
        try:
            # Homing heeds nothing but a reset.
            self._link.send(RESET if self._homing.is_set() else JOG_CANCEL + HOLD)
            with self._exclusive() as link:
                self._bring_to_rest(link, _RESET_LIMIT)
        except DeviceLostError:
            self.close()
            raise
        finally:
            self._stopped.clear()

    def _bring_to_rest(self, link: GrblLink, greeting_limit: float) -> None:
        """Halt by deceleration, then reset, which drops what is queued; only a reset in motion loses the position."""
        link.send(JOG_CANCEL + HOLD)
        link.forget()
        deadline = self._clock.now() + self.stopping_time
        with suppress(DeviceTimeoutError):
            while not link.report(_REPORT_LIMIT).rests and self._clock.now() < deadline:
                pass
        link.reset(greeting_limit)

    @contextmanager
    def _exclusive(self) -> Iterator[GrblLink]:
        if not self._turn.acquire(timeout=_TURN_LIMIT):
            raise DeviceTimeoutError("the GRBL stage is busy with another call. Stop it, then try again")
        try:
            yield self.link
        except DeviceLostError:
            self.close()
            raise
        finally:
            self._turn.release()
