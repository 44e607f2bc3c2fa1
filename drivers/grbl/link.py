"""The conversation with a GRBL 1.1 controller: lines and their answers, reports, the reset.

One line at a time, each answered by ``ok`` or ``error:N`` before the next one goes out. A line that is neither that nor
another known one is garbage: it is kept for the message and never interpreted. After garbage that cost an answer, the
two are out of step, and only a reset brings them together again: see `GrblLink.in_step`.
"""

from __future__ import annotations

import re
from collections import deque
from collections.abc import Iterator
from threading import Event

from drivers.clock import Clock
from drivers.errors import DeviceError, DeviceTimeoutError, UnsafeError
from drivers.grbl.codes import alarm, bad_state, refusal
from drivers.grbl.report import Report, machine_position, parse_report
from drivers.serial_link.port import SerialPort

QUERY, HOLD, RESUME, JOG_CANCEL, RESET, FULL_FEED = b"?", b"!", b"~", b"\x85", b"\x18", b"\x90"
"""Characters that act at once, wherever they stand in the stream."""

# As often as the documentation recommends at most. It also pushes out a line that is held back until the next byte.
_QUERY_PERIOD = 0.2
_ANSWER_LIMIT = 2.0
_LONGEST_LINE = 256  # bytes; what is longer has lost its end
_FEWEST_REPORTS = 3
_MOST_READS = 100  # at once, of a port that babbles
_RESET_PERIOD = 1.0  # seconds; a board that the opening of its port restarts hears nothing for a second or two
_ECHO_POLLS = 25  # of the port, without a word, after which no other reset is greeted any more

_BANNER = re.compile(r"Grbl(?:HAL)? (1\.1\w*) \[.*help\]")
_ANY_BANNER = re.compile(r"Grbl(?:HAL)? .*\[.*help\]")
_NUMBERED = re.compile(r"(error|ALARM):(\d{1,3})")

RESTARTED = "the controller restarted by itself, so that nobody knows where its axes stand"


class GrblLink:
    """A conversation over an open port.

    Parameters
    ----------
    port : SerialPort
    clock : Clock
        Whose seconds the limits are counted by.

    Attributes
    ----------
    version : str
        Of the firmware.
    in_step : bool
        Whether the next answer is that to the next question.
    homed : bool
        Whether it has been homed since the port was opened and has not restarted since; by its own word, where it has
        one for that.
    restarted : bool
        Whether it has greeted without being reset: its power failed, or somebody else reset it.
    """

    def __init__(self, port: SerialPort, clock: Clock) -> None:
        self._port = port
        self._clock = clock
        self._rest = b""
        self._looked = clock.now()
        self._arrived: deque[str] = deque()
        self._garbage: list[str] = []
        self._offset: tuple[float, ...] | None = None
        self._n_numbers: int | None = None
        self._alarm: int | None = None
        # A board that the opening of its port restarts greets once without having been reset.
        self._n_greetings_due = 1
        self.version = ""
        self.in_step = self.homed = self.restarted = False

    def send(self, character: bytes) -> None:
        """Send a character that acts at once; any thread may."""
        if RESET in character:
            self._n_greetings_due += 1
        self._port.write(character)

    def forget(self) -> None:
        """Drop what has arrived: it answers nothing that is asked from now on."""
        for _ in range(_MOST_READS):
            if not self._receive(wait=False):
                break
        self._rest = b""
        self._arrived.clear()
        self._garbage.clear()

    def raise_unasked(self) -> None:
        """Raise what the controller has said unasked: nothing may move before somebody has looked.

        Raises
        ------
        UnsafeError
            After an alarm, once; after a restart, until it is homed.
        """
        self.forget()
        number, self._alarm = self._alarm, None
        if number is not None:
            self.in_step = False
            raise UnsafeError(str(alarm(number)))
        if self.restarted:
            raise UnsafeError(f"{RESTARTED}. Look at its power; then connect the stage anew")

    def know_origin(self) -> None:
        """Take the origin for known: the limit switches have just been found."""
        self.homed, self.restarted = True, False

    def ask(self, line: str, seconds: float | None = None, stopped: Event | None = None) -> list[str]:
        """Send a line, wait for its ``ok``, return the lines that came before it.

        Parameters
        ----------
        line : str
            Without its end.
        seconds : float, optional
            The limit, if not the usual one; it stands still during a feed hold, which somebody is about to release.
        stopped : threading.Event, optional
            Set by another thread to end the wait.

        Raises
        ------
        DeviceError
            If the controller refuses the line, raises an alarm or is in a state in which it works no more, or if
            `stopped` is set.
        DeviceTimeoutError
            If there is no answer in time.
        """
        self.forget()
        _raise_if_set(stopped)
        came: list[str] = []
        limit = seconds or _ANSWER_LIMIT
        self.in_step, deadline = False, self._clock.now() + limit
        self._port.write(line.encode("ascii") + b"\n")
        for reply in self._lines():
            if reply == "ok":
                self.in_step = True
                return came
            if reply:
                self._raise_if_bad(reply, line)
                came.append(reply)
                if reply.startswith("<Hold"):
                    deadline = self._clock.now() + limit
                report = parse_report(reply)
                if report is not None and report.feed_override not in {None, 100}:
                    # Somebody turned it on the controller's own panel; the limits are those of full speed.
                    self.send(FULL_FEED)
            _raise_if_set(stopped)
            if self._is_over(deadline):
                raise self._silence(f"did not answer {line!r} within {limit:g} s")
        raise AssertionError("unreachable: the port yields lines for ever")

    def report(self, seconds: float = _ANSWER_LIMIT) -> Report:
        """Return the next whole status report; the one of a moment ago, if it was held back.

        Raises
        ------
        DeviceTimeoutError
            If none comes in time.
        """
        deadline = self._clock.now() + seconds
        self.send(QUERY)
        for reply in self._lines():
            report = parse_report(reply)
            if report is not None and self._n_numbers in {None, len(report.position)}:
                return report
            if self._is_over(deadline):
                raise self._silence(f"sent no status report within {seconds:g} s")
        raise AssertionError("unreachable: the port yields lines for ever")

    def at_rest(self) -> tuple[Report, tuple[float, ...]]:
        """Return a report of now and its machine position, which two reports in a row agree on.

        What follows the answer to an empty line was reported after it: nothing that was held back passes for new.
        A digit that got lost on the wire makes a report that looks whole; it does not make the same one twice.

        Returns
        -------
        report : Report
        position : tuple of float, shape (n_letters,)
            In the controller's units.

        Raises
        ------
        DeviceTimeoutError
            If no two agree in time.
        """
        self.ask("")
        deadline, before, n_reports = self._clock.now() + _ANSWER_LIMIT, None, 0
        # However long the computer was busy, one report may be spoiled.
        while self._clock.now() < deadline or n_reports < _FEWEST_REPORTS:
            report, n_reports = self.report(), n_reports + 1
            position = machine_position(report, self._offset)
            now = (report.state, position)
            if now == before and position is not None and report.rests:
                self._n_numbers = len(position)
                return report, position
            before = now
        if report.state in {"Run", "Jog", "Home"}:
            raise bad_state(report.state)
        raise self._silence(f"sent no two status reports that agree within {_ANSWER_LIMIT:g} s")

    def reset(self, seconds: float) -> None:
        """Reset the controller until it greets, and be in step with it.

        At rest it keeps its position; in motion it loses it and locks itself.

        Raises
        ------
        DeviceTimeoutError
            If nothing answers in time.
        DeviceError
            If something else than GRBL 1.1 does.
        """
        self.forget()
        self._offset = None
        began = self._clock.now()
        self.send(RESET)
        again = began + _RESET_PERIOD
        for reply in self._lines():
            if _ANY_BANNER.fullmatch(reply):
                return self._greeted(reply)
            if self._is_over(began + seconds):
                raise self._no_greeting(seconds)
            if (now := self._clock.now()) > again:
                # The line end, which the reset makes GRBL forget, lets another device say that it understands nothing.
                self.send(b"\n" + RESET)
                again = now + _RESET_PERIOD
        raise AssertionError("unreachable: the port yields lines for ever")

    def _greeted(self, banner: str) -> None:
        match = _BANNER.fullmatch(banner)
        if match is None:
            raise DeviceError(f"{self._port.name}: {banner!r} is no GRBL 1.1. Install GRBL 1.1 on the controller")
        self.version = match[1]
        # Of several resets, and the start of the board itself, the greetings come one after the other.
        n_silent = 0
        while self._n_greetings_due > 0 and n_silent < _ECHO_POLLS:
            n_silent = 0 if self._receive() else n_silent + 1
        self._n_greetings_due = 0
        self.ask("")

    def _lines(self) -> Iterator[str]:
        """Yield each line as it arrives, and an empty one whenever there is none; ask for a report now and then."""
        asked = self._clock.now()
        while True:
            if not self._arrived:
                self._receive()
            yield self._arrived.popleft() if self._arrived else ""
            if self._clock.now() - asked > _QUERY_PERIOD:
                self.send(QUERY)
                asked = self._clock.now()

    def _is_over(self, deadline: float) -> bool:
        """Whether the port was looked at after `deadline`, and nothing of what had arrived is left.

        A computer that was busy for so long finds the answer waiting; it came in time.
        """
        return self._looked > deadline and not self._arrived

    def _receive(self, wait: bool = True) -> bytes:
        self._looked = self._clock.now()
        received = self._port.read(wait=wait)
        *lines, rest = (self._rest + received).split(b"\n")
        self._rest = rest[-_LONGEST_LINE:]
        for raw in lines:
            line = raw.decode("ascii", "replace").strip("\r")
            self._learn(line)
            self._arrived.append(line)
        return received

    def _learn(self, line: str) -> None:
        report, numbered = parse_report(line), _NUMBERED.fullmatch(line)
        if report is not None:
            self._offset = report.offset or self._offset
            self.homed = self.homed if report.homed is None else report.homed
        elif _ANY_BANNER.fullmatch(line):
            self._heed_greeting()
        elif numbered is not None and numbered[1] == "ALARM":
            self._alarm = int(numbered[2])
        elif line and not _is_known(line):
            self._garbage.append(line)

    def _heed_greeting(self) -> None:
        if self._n_greetings_due > 0:
            self._n_greetings_due -= 1
        else:
            self.homed, self.restarted = False, True

    def _raise_if_bad(self, reply: str, line: str) -> None:
        if (match := _NUMBERED.fullmatch(reply)) is not None:
            self.in_step = match[1] == "error"
            if self.in_step:
                raise refusal(int(match[2]), line)
            self._alarm = None
            raise alarm(int(match[2]))
        if _ANY_BANNER.fullmatch(reply) and self.restarted:
            raise UnsafeError(f"{RESTARTED}. Look at its power; then connect the stage anew")
        report = parse_report(reply)
        # A locked controller answers all the same, and by number.
        if report is not None and report.state in {"Door", "Sleep"}:
            raise bad_state(report.state)

    def _silence(self, what: str) -> DeviceTimeoutError:
        self.in_step = False
        return DeviceTimeoutError(f"the controller at {self._port.name} {what}{self._received()}.")

    def _received(self) -> str:
        shown = ", ".join(repr(line[:40]) for line in self._garbage[:3])
        return f"; instead came {shown}. Look at the cable" if shown else ". Look at the cable and the power"

    def _no_greeting(self, seconds: float) -> DeviceError:
        if self._garbage or self._rest:
            came = (self._garbage or [self._rest.decode("ascii", "replace")])[0]
            return DeviceError(
                f"what answers at {self._port.name} is no GRBL 1.1; it sent {came[:40]!r}. "
                "Correct stage.port, or the baud rate"
            )
        return DeviceTimeoutError(
            f"nothing answered at {self._port.name} within {seconds:g} s. "
            "Look at the power of the controller and the cable; correct stage.port, or the baud rate"
        )


def _is_known(line: str) -> bool:
    return (
        line == "ok"
        or line[0] in "$>["
        or _NUMBERED.fullmatch(line) is not None
        or _ANY_BANNER.fullmatch(line) is not None
    )


def _raise_if_set(stopped: Event | None) -> None:
    if stopped is not None and stopped.is_set():
        raise DeviceError("the motion was stopped. Find out why, then move again.")
