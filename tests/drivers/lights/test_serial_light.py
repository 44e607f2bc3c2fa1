"""A LED driver on a serial port that fails in every way that a port does."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import Any

import pytest

from drivers.errors import DeviceError, DeviceLimitError, DeviceLostError, DeviceTimeoutError, UnsafeError
from drivers.light import LightState
from drivers.light_supervisor import _Supervisor
from drivers.serial_light.light import SerialLight
from drivers.serial_light.settings import SerialLightSettings
from drivers.serial_link.port import SerialPort
from drivers.supervised_light import SupervisedLight
from tests.drivers.double_clock import until
from tests.drivers.lights.serial_light_double import SerialLightDouble
from tests.drivers.lights.test_supervised_light import ROOT

LIT_PARENT = """
import sys, time
from drivers.supervised_light import SupervisedLight

light = SupervisedLight([sys.executable, "-m", "tests.drivers.lights.supervised_serial_light", sys.argv[1]])
light.connect()
light.on(1.0, 300.0)
print("lit", flush=True)
time.sleep(3600.0)
"""


@pytest.fixture
def double() -> Iterator[SerialLightDouble]:
    double = SerialLightDouble()
    yield double
    double.unplug()


@pytest.fixture
def light(double: SerialLightDouble) -> Iterator[SerialLight]:
    light = SerialLight(settings(double))
    yield light
    light._forget()


def settings(double: SerialLightDouble, **values: Any) -> SerialLightSettings:
    return SerialLightSettings(**{"port": double.port, "identity": "blinker", "answer_time_s": 1.5, **values})


def n_open(port: str) -> int:
    """Count the descriptors of a port in this process; the double has one of them."""
    return sum(os.path.realpath(fd) == port for fd in Path("/proc/self/fd").iterdir()) - 1


def test_connecting_darkens_a_light_that_somebody_left_on(double: SerialLightDouble, light: SerialLight) -> None:
    assert double.lit
    light.connect()
    assert not double.lit


def test_says_what_the_driver_is(light: SerialLight) -> None:
    light.connect()
    assert light.describe().model == "blinker 2.1"
    assert light.describe().serial_number == "blinker 2.1"


def test_a_port_that_is_not_there_is_named() -> None:
    with pytest.raises(DeviceError, match=r"/dev/no-such-port.* no such port"):
        SerialLight(SerialLightSettings(port="/dev/no-such-port", identity="x")).connect()


def test_a_port_that_another_program_holds_is_busy(double: SerialLightDouble, light: SerialLight) -> None:
    other = SerialPort(double.port, 115200, 0.1)
    with pytest.raises(DeviceError, match="Another program uses the port"):
        light.connect()
    other.close()
    light.connect()


def test_another_device_at_the_port_is_refused_and_not_switched(double: SerialLightDouble, light: SerialLight) -> None:
    double.identity = "Grbl 1.1h"
    with pytest.raises(DeviceError, match=r"answers 'ID\?' with 'Grbl 1\.1h'; expected was something with 'blinker'"):
        light.connect()
    assert double.heard == ["ID?"]
    assert n_open(double.port) == 0


def test_a_device_that_says_nothing_is_a_timeout(double: SerialLightDouble, light: SerialLight) -> None:
    double.mute = True
    with pytest.raises(
        DeviceTimeoutError, match=r"did not answer 'ID\?' within 1\.5 s: nothing came\. Look at the power"
    ):
        light.connect()
    assert n_open(double.port) == 0


def test_half_a_line_is_no_answer(double: SerialLightDouble, light: SerialLight) -> None:
    light.connect()
    double.instead["STATE?"] = b"ON 5"
    with pytest.raises(DeviceTimeoutError, match=r"only b'ON 5' came"):
        light.read()
    double.instead.clear()
    assert light.on(0.5, 1.0).level == pytest.approx(0.5)


def test_what_was_said_unasked_is_no_answer(double: SerialLightDouble, light: SerialLight) -> None:
    double.say(b"ready.\r\nON 99.00\r\n")
    light.connect()
    unasked = b"\xff\xfeON 99.00\r\nOK\r\n"
    double.say(unasked)
    until(lambda: light._port._serial.in_waiting == len(unasked))
    assert not light.read().lit


def test_an_answer_that_comes_late_is_not_that_to_the_next_question(
    double: SerialLightDouble, light: SerialLight
) -> None:
    light.connect()
    double.may_answer.clear()
    with pytest.raises(DeviceTimeoutError):
        light.off()
    double.may_answer.set()
    until(lambda: light._port._serial.in_waiting > 0)
    assert not light.read().lit


def test_a_device_that_never_stops_talking_is_given_up(double: SerialLightDouble, light: SerialLight) -> None:
    light.connect()
    double.instead["STATE?"] = b"x" * 2000
    with pytest.raises(DeviceError, match="with a line that does not end"):
        light.read()


@pytest.mark.parametrize("answer", [b"ERR\r\n", b"ON\r\n", b"\xff\xff 50\r\n", b"ON -5\r\n"])
def test_an_answer_that_makes_no_sense_is_quoted_and_never_a_state(
    double: SerialLightDouble, light: SerialLight, answer: bytes
) -> None:
    light.connect()
    double.instead["STATE?"] = answer
    with pytest.raises(DeviceError, match=r"answers 'STATE\?' with '.*'; expected was a line that matches"):
        light.read()


def test_a_command_that_is_refused_is_quoted_and_leaves_the_light_dark(
    double: SerialLightDouble, light: SerialLight
) -> None:
    light.connect()
    double.instead["LEVEL 50.00"] = b"ERR too hot\r\n"
    with pytest.raises(DeviceError, match=r"answers 'LEVEL 50\.00' with 'ERR too hot'; expected was 'OK'"):
        light.on(0.5, 1.0)
    assert not double.lit
    assert double.n_switched_on == 0


def test_a_level_that_does_not_hold_is_found_by_its_read_back_and_darkened(
    double: SerialLightDouble, light: SerialLight
) -> None:
    light.connect()
    double.instead["STATE?"] = b"ON 40.00\r\n"
    with pytest.raises(
        DeviceError, match=r"was set to level 0\.5 and reads back 0\.4; allowed is a difference of 0\.0005"
    ):
        light.on(0.5, 1.0)
    assert not double.lit


@pytest.mark.parametrize("level", [0.1, 0.3, 0.5, 0.7, 0.9])
def test_a_level_that_a_driver_of_eight_bits_rounds_holds(double: SerialLightDouble, level: float) -> None:
    """Sent as whole numbers, read back as whole numbers, and no tolerance stated."""
    sent = f"{255 * level:.0f}"
    double.instead |= {f"L{sent}": b"OK\r\n", "STATE?": b"OFF 0\r\n"}
    light = SerialLight(settings(double, level_command="L{level:.0f}", full_level=255.0))
    light.connect()
    double.instead["STATE?"] = f"ON {sent}\r\n".encode()
    assert light.on(level, 1.0).level == pytest.approx(level, abs=0.5 / 255)
    double.instead["STATE?"] = f"ON {int(sent) + 2}\r\n".encode()
    with pytest.raises(DeviceError, match="reads back"):
        light.on(level, 1.0)
    light._forget()


def test_an_answer_too_coarse_to_tell_a_level_tells_none(double: SerialLightDouble) -> None:
    double.instead |= {"LEVEL 0.70": b"OK\r\n", "STATE?": b"OFF 0\r\n"}
    light = SerialLight(settings(double, full_level=1.0, level_tolerance=0.01))
    light.connect()
    double.instead["STATE?"] = b"ON 1\r\n"
    with pytest.raises(DeviceError, match=r"set to level 0\.7 and reads back 1"):
        light.on(0.7, 1.0)
    light._forget()


def test_an_empty_line_beside_an_answer_is_none(double: SerialLightDouble, light: SerialLight) -> None:
    double.instead |= {"ID?": b"\r\nblinker 3\r\n\r\n", "OFF": b"\n\nOK\n\n"}
    light.connect()
    assert light.describe().model == "blinker 3"
    assert light.on(0.5, 1.0).level == 0.5


def test_a_board_that_still_boots_is_told_how_long_to_wait(double: SerialLightDouble, light: SerialLight) -> None:
    double.mute = True
    with pytest.raises(DeviceTimeoutError, match="boots when its port is opened needs boot_time_s"):
        light.connect()


def test_a_light_that_echoes_is_told_apart(double: SerialLightDouble, light: SerialLight) -> None:
    double.instead["OFF"] = b"OFF\r\nOK\r\n"
    with pytest.raises(DeviceError, match="switch its echo off"):
        light.connect()


def test_a_light_that_does_not_go_off_is_said_to_be_lit(double: SerialLightDouble, light: SerialLight) -> None:
    light.connect()
    light.on(1.0, 10.0)
    double.sticks_on = True
    assert light.off().lit


def test_a_light_that_cannot_be_darkened_is_not_connected(double: SerialLightDouble, light: SerialLight) -> None:
    double.sticks_on = True
    with pytest.raises(UnsafeError, match=r"does not go off\. Switch it off by hand"):
        light.connect()
    assert n_open(double.port) == 0


def test_level_zero_is_dark(double: SerialLightDouble, light: SerialLight) -> None:
    light.connect()
    assert not light.on(0.0, 1.0).lit
    assert double.n_switched_on == 0


def test_a_lease_longer_than_the_settings_allow_is_refused(double: SerialLightDouble, light: SerialLight) -> None:
    light.connect()
    with pytest.raises(DeviceLimitError, match=r"max_seconds is 301 s; allowed is up to 300 s"):
        light.on(0.5, 301.0)
    assert double.n_switched_on == 0


def test_a_driver_that_was_unplugged_is_lost_and_may_be_connected_again(
    double: SerialLightDouble, light: SerialLight
) -> None:
    light.connect()
    double.unplug()
    for act in (light.read, lambda: light.on(0.5, 1.0)):
        with pytest.raises(DeviceLostError):
            act()
        assert light._port is None
    assert not light.off().lit  # it was dark, and nothing has reached it since
    successor = SerialLightDouble()
    light._settings = settings(successor)
    light.connect()
    assert light.on(0.5, 1.0).lit
    light.disconnect()
    successor.unplug()


def test_other_words_come_from_the_rig_file(double: SerialLightDouble) -> None:
    words = {
        "level_command": "L{level:.0f}",
        "on_command": "1",
        "off_command": "0",
        "state_command": "?",
        "done": ">",
        "state": r"(?P<level>\d+)(?P<lit>\*)?",
        "full_level": 255.0,
        "level_tolerance": 0.5,
    }
    double.instead = {"L128": b">\n", "1": b">\n", "0": b">\n", "?": b"0\n"}
    light = SerialLight(settings(double, **words))
    light.connect()
    double.instead["?"] = b"128*\n"
    assert light.on(0.5, 1.0).level == pytest.approx(128 / 255)
    assert double.heard == ["ID?", "0", "?", "L128", "1", "?"]
    light._forget()


def test_the_supervisor_does_not_wait_for_a_light_that_is_gone(double: SerialLightDouble, light: SerialLight) -> None:
    light.connect()
    light.on(0.5, 1.0)
    double.unplug()
    tries, off = [], light.off

    def counted() -> LightState:
        tries.append("off")
        return off()

    light.off = counted  # type: ignore[method-assign]
    _Supervisor(light).darken()
    assert tries == ["off"]


SUPERVISED = [sys.executable, "-m", "tests.drivers.lights.supervised_serial_light"]


def supervised(double: SerialLightDouble) -> SupervisedLight:
    light = SupervisedLight([*SUPERVISED, double.port])
    light.connect()
    return light


@pytest.mark.parametrize("reconnects", [False, True])
def test_a_light_whose_cable_is_pulled_while_it_shines_is_never_said_to_be_dark(
    double: SerialLightDouble, reconnects: bool
) -> None:
    """The lamp's own record is what counts: it still shines."""
    light = supervised(double)
    light.on(0.5, 30.0)
    double.unplug()
    assert double.lit
    if reconnects:
        with pytest.raises(DeviceLostError, match="may still shine"):
            light.disconnect()
        with pytest.raises(DeviceError):
            light.connect()
    for _ in range(2):
        with pytest.raises(DeviceLostError, match="may still shine: switch it off by hand"):
            light.off()
    with suppress(DeviceLostError):
        light.disconnect()


def test_a_light_that_was_dark_when_its_cable_was_pulled_is_known_to_be_dark(double: SerialLightDouble) -> None:
    light = supervised(double)
    light.on(0.5, 30.0)
    light.off()
    double.unplug()
    assert not double.lit
    assert not light.off().lit
    light.disconnect()
    assert not light.off().lit


def test_a_light_that_comes_back_is_known_to_be_dark_again(double: SerialLightDouble) -> None:
    light = supervised(double)
    light.on(0.5, 30.0)
    double.unplug()
    with pytest.raises(DeviceLostError, match="may still shine"):
        light.disconnect()
    successor = SerialLightDouble()
    light._command = [*SUPERVISED, successor.port]
    light.connect()
    assert not successor.lit
    assert not light.off().lit
    light.disconnect()
    successor.unplug()


def test_nothing_is_known_of_a_light_whose_supervisor_was_killed_while_it_shone(double: SerialLightDouble) -> None:
    light = supervised(double)
    light.on(0.5, 30.0)
    assert light._process is not None
    light._process.kill()
    with pytest.raises(DeviceLostError, match="may still shine"):
        light.off()
    with pytest.raises(DeviceLostError, match="may still shine"):
        light.disconnect()


def seconds_lit_after_death(double: SerialLightDouble) -> float:
    """Kill the parent of a light with a lease of minutes."""
    parent = subprocess.Popen([sys.executable, "-c", LIT_PARENT, double.port], stdout=subprocess.PIPE, cwd=ROOT)
    assert parent.stdout is not None
    with parent:
        assert parent.stdout.readline() == b"lit\n"
        assert double.lit
        parent.send_signal(signal.SIGKILL)
    died = time.monotonic()
    until(lambda: not double.lit)
    return time.monotonic() - died


def test_the_light_goes_off_when_its_parent_dies(double: SerialLightDouble) -> None:
    seconds_lit_after_death(double)


@pytest.mark.slow
@pytest.mark.alone
def test_the_light_goes_off_within_a_second_of_the_death_of_its_parent(double: SerialLightDouble) -> None:
    assert seconds_lit_after_death(double) < 1.0


def test_a_missing_port_is_said_once_through_the_supervisor_too(capfd: pytest.CaptureFixture[str]) -> None:
    light = SupervisedLight([sys.executable, "-m", "tests.drivers.lights.supervised_serial_light", "/dev/no-such-port"])
    with pytest.raises(DeviceError, match=r"/dev/no-such-port.* no such port"):
        light.connect()
    assert capfd.readouterr().err == ""


def test_a_light_that_is_lost_under_its_supervisor_ends_without_a_traceback(
    double: SerialLightDouble, capfd: pytest.CaptureFixture[str]
) -> None:
    light = SupervisedLight([sys.executable, "-m", "tests.drivers.lights.supervised_serial_light", double.port])
    light.connect()
    double.unplug()
    with pytest.raises(DeviceLostError):
        light.on(1.0, 5.0)
    light.disconnect()
    assert capfd.readouterr().err == ""


def test_a_light_that_may_have_come_on_without_saying_so_goes_off_by_itself(double: SerialLightDouble) -> None:
    light = SupervisedLight([sys.executable, "-m", "tests.drivers.lights.supervised_serial_light", double.port])
    light.connect()
    double.instead = {"ON": b"", "OFF": b""}
    double.sticks_on = True
    with pytest.raises(DeviceTimeoutError):
        light.on(1.0, 60.0)
    assert double.lit
    double.instead, double.sticks_on = {}, False
    until(lambda: not double.lit)
    light.disconnect()


@pytest.mark.slow
def test_an_answer_that_is_missing_anywhere_leaves_nothing_open_and_no_light_on() -> None:
    n_questions = len(_session(silent=-1))
    assert n_questions > 6
    for i_question in range(n_questions):
        assert "OFF" in _session(silent=i_question) or i_question == 0


def _session(silent: int) -> list[str]:
    double = SerialLightDouble()
    double.silent = {silent}
    light = SerialLight(settings(double, answer_time_s=0.3))
    missing = suppress(DeviceTimeoutError) if silent >= 0 else nullcontext()
    with missing:
        light.connect()
        light.on(0.5, 5.0)
        light.off()
    with missing:
        light.disconnect()
    assert not double.lit or silent == 0
    assert n_open(double.port) == 0
    double.unplug()
    return double.heard
