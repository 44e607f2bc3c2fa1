"""The double keeps to the firmware's documentation, whatever the driver makes of it."""

from collections.abc import Iterator

import pytest
import serial

from tests.drivers.double_clock import HANG, until
from tests.drivers.grbl.grbl_double import GrblDouble


class Terminal:
    """A port and what has come from it."""

    def __init__(self, double: GrblDouble) -> None:
        self.port = serial.Serial(double.port, timeout=HANG)
        self._double = double
        self._n_said = self._n_heard = 0

    def say(self, raw: bytes) -> list[str]:
        self.port.write(raw)
        self._n_said += len(raw)
        return self.hear()

    def hear(self) -> list[str]:
        """Return all that is sent until everything said so far has been acted on."""
        until(lambda: self._double.exchanged()[0] == self._n_said)
        n_new = self._double.exchanged()[1] - self._n_heard
        self._n_heard += n_new
        return self.port.read(n_new).decode().split("\r\n")[:-1]


@pytest.fixture
def double() -> Iterator[GrblDouble]:
    with GrblDouble(pace=1.0) as double:
        yield double


@pytest.fixture
def terminal(double: GrblDouble) -> Iterator[Terminal]:
    terminal = Terminal(double)
    yield terminal
    terminal.port.close()


def test_an_empty_line_is_answered(terminal: Terminal):
    assert terminal.say(b"\n") == ["ok"]


def test_a_reset_at_rest_greets_and_keeps_the_position(terminal: Terminal):
    assert terminal.say(b"\x18") == ["", "Grbl 1.1h ['$' for help]"]
    assert terminal.say(b"?") == ["<Idle|MPos:-100.000,-100.000,0.000|FS:0,0|WCO:0.000,0.000,0.000>"]
    assert terminal.say(b"?") == ["<Idle|MPos:-100.000,-100.000,0.000|FS:0,0|Ov:100,100,100>"]


def move(terminal: Terminal, double: GrblDouble, line: bytes) -> None:
    """Let a motion begin, and wait there."""
    double.waits_after = 0.05
    assert terminal.say(line) == ["ok"]
    until(double.waits)


def test_a_reset_in_motion_is_an_alarm_and_locks(terminal: Terminal, double: GrblDouble):
    move(terminal, double, b"G53G1X-150F2400\n")
    assert terminal.say(b"\x18") == ["ALARM:3", "", "Grbl 1.1h ['$' for help]", "[MSG:'$H'|'$X' to unlock]"]
    assert terminal.say(b"G1X-10F100\n") == ["error:9"]
    assert terminal.say(b"$J=X-10F100\n") == ["error:8"]
    assert terminal.say(b"$X\n") == ["[MSG:Caution: Unlocked]", "ok"]


def test_a_line_of_g_code_is_answered_before_it_has_ended_and_a_dwell_after(terminal: Terminal, double: GrblDouble):
    move(terminal, double, b"G53G1X-110F2400\n")
    assert terminal.say(b"?")[0].startswith("<Run|")
    assert terminal.say(b"G4P0\n") == []
    n_sent = double.exchanged()[1]
    double.go_on()
    until(lambda: double.exchanged()[1] > n_sent)
    assert terminal.hear() == ["ok"]
    assert terminal.say(b"?")[0].startswith("<Idle|MPos:-110.000,")


def test_a_hold_brakes_and_a_resume_goes_on(terminal: Terminal, double: GrblDouble):
    move(terminal, double, b"G53G1X-110F2400\n")
    terminal.say(b"!")
    until(lambda: not double.moves())
    assert terminal.say(b"?")[0].startswith("<Hold:0|")
    assert terminal.say(b"\n") == []
    assert terminal.say(b"~") == ["ok"]
    until(lambda: not double.machine.queue)
    assert double.machine.position[0] == -110.0


def test_a_hold_at_rest_is_a_hold(terminal: Terminal):
    assert terminal.say(b"!?")[0].startswith("<Hold:0|")
    assert terminal.say(b"~?")[0].startswith("<Idle|")


def test_a_jog_beyond_the_travel_is_an_error_and_a_move_there_an_alarm(terminal: Terminal):
    assert terminal.say(b"$J=G53X1F100\n") == ["error:15"]
    assert terminal.say(b"G53G0X1\n") == ["ALARM:2", "[MSG:Reset to continue]"]
    assert terminal.say(b"?") == []
    assert terminal.say(b"\x18")[-1] == "[MSG:'$H'|'$X' to unlock]"


def test_a_jog_locks_out_g_code_and_is_cancelled_without_an_alarm(terminal: Terminal, double: GrblDouble):
    move(terminal, double, b"$J=G53X-150F2400\n")
    assert terminal.say(b"G0X-10\n") == ["error:9"]
    terminal.say(b"\x85")
    until(lambda: not double.moves())
    assert terminal.say(b"?")[0].startswith("<Idle|")


@pytest.mark.parametrize(
    ("line", "number"),
    [
        (b"5", 1),
        (b"GX", 2),
        (b"$Q", 3),
        (b"X" * 90, 11),
        (b"$JX1", 3),
        (b"G99", 20),
        (b"G0G1X0", 21),
        (b"G1X-1", 22),
        (b"X-1X-2", 25),
        (b"G53", 26),
        (b"G4", 28),
        (b"G0A1", 36),
    ],
)
def test_a_bad_line_has_its_number(terminal: Terminal, line: bytes, number: int):
    assert terminal.say(line + b"\n") == [f"error:{number}"]


def test_settings_are_printed_as_the_firmware_prints_them(terminal: Terminal):
    lines = terminal.say(b"$$\n")
    assert {"$13=0", "$24=300.000", "$110=2400.000", "$130=200.000"} < set(lines)
    assert lines[-1] == "ok"


def test_homing_is_deaf_to_all_but_a_reset(terminal: Terminal, double: GrblDouble):
    double.waits_after = 0.05
    assert terminal.say(b"$H\n") == []
    until(double.waits)
    assert terminal.say(b"?!") == []
    assert terminal.say(b"\x18")[:2] == ["ALARM:6", "ok"]
