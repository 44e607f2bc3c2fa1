import errno
import os
from collections.abc import Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from threading import Event

import pytest
import serial

from drivers.errors import (
    CancelledError,
    DeviceError,
    DeviceLimitError,
    DeviceLostError,
    DeviceTimeoutError,
    UnsafeError,
)
from drivers.grbl.stage import GrblStage
from instrument.rig.bounded import BoundedStage
from tests.drivers.double_clock import HANG, HastyClock, until
from tests.drivers.grbl.grbl_double import GrblDouble
from tests.drivers.grbl.grbl_stages import TILT, TURN, settings_of

LONG = {"turn": 170.0}


@pytest.fixture
def double() -> Iterator[GrblDouble]:
    with GrblDouble() as double:
        yield double


@pytest.fixture
def stage(double: GrblDouble) -> Iterator[GrblStage]:
    stage = GrblStage(settings_of(double), double.clock)
    stage.connect()
    if double.state == "Idle":
        stage.home()
    yield stage
    stage.disconnect()


@pytest.fixture
def slow() -> Iterator[GrblDouble]:
    """A controller that a test can interfere with while it moves: on its way it waits for that."""
    with GrblDouble(pace=2.0) as double:
        double.waits_after = 0.3
        yield double


@pytest.fixture
def slow_stage(slow: GrblDouble) -> Iterator[GrblStage]:
    stage = GrblStage(settings_of(slow), slow.clock)
    stage.connect()
    slow.pace = 50.0
    stage.home()
    slow.pace = 2.0
    slow.go_on()
    slow.waits_after = 0.3
    yield stage
    stage.disconnect()


@pytest.fixture
def begin() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as executor:
        yield executor


def moving(executor: ThreadPoolExecutor, stage: GrblStage, double: GrblDouble) -> Future[dict[str, float]]:
    move = executor.submit(stage.move, LONG)
    until(double.waits)
    return move


def hasty(double: GrblDouble) -> HastyClock:
    return HastyClock(double.clock, 5.0)


def is_free(port: str) -> bool:
    serial.Serial(port, exclusive=True).close()
    return True


class TestConnecting:
    def test_tells_what_the_controller_is(self, stage: GrblStage):
        described = stage.describe()
        assert (described.make, described.model, described.firmware) == ("GRBL", "1.1h", "1.1h.20190830")
        assert described.serial_number == "bench 7"

    def test_a_port_that_is_not_there_is_named_with_those_that_are(self, double: GrblDouble):
        with pytest.raises(DeviceError, match=r"cannot open /dev/none. There is no such port.*Ports here: "):
            GrblStage(settings_of(double, port="/dev/none"), double.clock).connect()

    @pytest.mark.parametrize(
        ("number", "mend"), [(errno.EACCES, "usermod -aG dialout"), (errno.EBUSY, r"uses the port \(process \d+")]
    )
    def test_a_port_that_may_not_be_opened_comes_with_its_mend(self, double, monkeypatch, number: int, mend: str):
        def refuse(*_):
            raise OSError(number, os.strerror(number))

        monkeypatch.setattr("serial.serialposix.os.open", refuse)
        with pytest.raises(DeviceError, match=mend):
            GrblStage(settings_of(double), double.clock).connect()

    def test_a_port_that_another_program_uses_is_left_to_it(self, double: GrblDouble):
        with (
            serial.Serial(double.port, exclusive=True),
            pytest.raises(DeviceError, match="Another program uses the port"),
        ):
            GrblStage(settings_of(double), double.clock).connect()

    def test_a_file_is_no_port(self, double: GrblDouble, tmp_path: Path):
        path = tmp_path / "port"
        path.touch()
        with pytest.raises(DeviceError, match="That is no serial port"):
            GrblStage(settings_of(double, port=str(path)), double.clock).connect()

    @pytest.mark.parametrize("banner", ["Marlin 2.1.2", "Grbl 0.9j ['$' for help]"])
    def test_another_device_on_the_port_is_told_by_what_it_says(self, double: GrblDouble, banner: str):
        double.banner = banner
        with pytest.raises(DeviceError, match=r"is no GRBL 1\.1") as caught:
            GrblStage(settings_of(double), hasty(double)).connect()
        assert banner in str(caught.value)
        assert is_free(double.port)

    def test_silence_is_not_waited_out_for_ever(self, double: GrblDouble):
        double.silent = True
        with pytest.raises(DeviceTimeoutError, match=r"nothing answered at .* within 6 s"):
            GrblStage(settings_of(double), hasty(double)).connect()
        assert is_free(double.port)

    def test_settings_that_do_not_fit_are_said_at_once_and_nothing_is_set(self):
        wrong = {13: 1, 22: 0, 110: 0.0, 131: 120.0}
        with GrblDouble(settings=wrong) as double, pytest.raises(DeviceError) as caught:
            GrblStage(settings_of(double), double.clock).connect()
        for part in ("set $13=0", "$22=1", "axis turn: $110 must be above 0", "axis tilt: soft_limits are -165 to -35"):
            assert part in str(caught.value)
        assert not [line for line in double.received if "=" in line]

    def test_an_axis_that_the_firmware_does_not_have_is_named(self, double: GrblDouble):
        with pytest.raises(DeviceError, match=r"no axis A .*correct the letter of axis tilt"):
            GrblStage(settings_of(double, axes=(TILT.model_copy(update={"letter": "A"}), TURN)), double.clock).connect()

    def test_a_tolerance_finer_than_a_step_is_refused(self, double: GrblDouble):
        with pytest.raises(DeviceError, match=r"axis tilt: tolerance 0.001 is finer than a step; allowed from 0.0055"):
            GrblStage(
                settings_of(double, axes=(TILT.model_copy(update={"tolerance": 0.001}), TURN)), double.clock
            ).connect()

    def test_a_stage_that_moves_is_brought_to_rest_and_keeps_its_position(self, slow: GrblDouble):
        slow.jog("X-180F2400")
        until(slow.waits)
        stage = GrblStage(settings_of(slow), slow.clock)
        stage.connect()
        assert not slow.moves()
        assert slow.state == "Idle"
        assert -180.0 < slow.machine.position[0] < -100.0
        stage.disconnect()


class TestLocked:
    @pytest.fixture
    def double(self) -> Iterator[GrblDouble]:
        with GrblDouble(homed=False) as double:
            yield double

    def test_a_locked_controller_has_no_position_and_does_not_move(self, stage: GrblStage, double: GrblDouble):
        for act in (stage.read, lambda: stage.move({"tilt": 1.0})):
            with pytest.raises(DeviceError, match=r"its position is unknown\. Home the stage"):
                act()
        assert not [line for line in double.received if line.startswith("G")]

    def test_homing_frees_it_and_ends_at_zero(self, stage: GrblStage):
        stage.home()
        assert stage.read() == {"tilt": 0.0, "turn": 0.0}

    def test_the_time_of_a_move_is_told_before_it_is_homed(self, stage: GrblStage):
        before = stage.move_duration({"tilt": 30.0})
        stage.home()
        assert before == stage.move_duration({"tilt": 30.0}) > 0.0

    def test_the_time_limit_of_homing_explains_a_switch_that_is_missing(self, stage: GrblStage, double: GrblDouble):
        double.switch_is_missing = True
        with pytest.raises(UnsafeError, match="ALARM:9, homing failed: no limit switch found"):
            stage.home()

    def test_nothing_unlocks_it_but_the_operator(self):
        with GrblDouble(settings={20: 0, 22: 0}) as double:
            double.state = "Alarm"
            stage = GrblStage(settings_of(double, homing=False), double.clock)
            stage.connect()
            for act in (stage.home, stage.read, lambda: stage.move({"tilt": 1.0}), stage.stop, stage.connect):
                try:
                    act()
                except DeviceError as error:
                    assert "unlock it by hand with $X" in str(error)  # noqa: PT017 - some of them do not raise
            stage.disconnect()
            assert "$X" not in double.received
            assert double.state == "Alarm"


def test_without_limit_switches_homing_goes_back_to_where_it_was_switched_on():
    with GrblDouble(settings={20: 0, 22: 0}) as double:
        stage = GrblStage(settings_of(double, homing=False), double.clock)
        stage.connect()
        stage.move({"tilt": 20.0})
        stage.home()
        assert stage.read()["tilt"] == 0.0
        assert "$H" not in double.received
        stage.disconnect()


class TestOrigin:
    """Where the axes stand is known by evidence of this connection, or not at all."""

    def test_an_idle_controller_that_was_not_homed_is_not_moved(self, double: GrblDouble):
        """As grblHAL boots with $22=1."""
        stage = GrblStage(settings_of(double), double.clock)
        stage.connect()
        for act in (stage.read, lambda: stage.move({"tilt": 1.0})):
            with pytest.raises(DeviceError, match=r"not homed since it was connected.*Home the stage"):
                act()
        assert not [line for line in double.received if line.startswith("G")]
        stage.home()
        assert stage.read() == {"tilt": 0.0, "turn": 0.0}
        stage.disconnect()

    def test_a_restart_at_rest_is_kept_until_the_next_call(self, stage: GrblStage, double: GrblDouble):
        moved = [line for line in double.received if line.startswith("G21")]
        double.settings[22] = 0  # so that it is not locked, which would tell
        double.power_cycle()
        until(lambda: double.exchanged()[1] > 0)
        for _ in range(2):
            with pytest.raises(UnsafeError, match="restarted by itself, so that nobody knows where its axes stand"):
                stage.move({"tilt": 1.0})
        assert [line for line in double.received if line.startswith("G21")] == moved

    def test_homing_mends_a_restart(self, stage: GrblStage, double: GrblDouble):
        double.power_cycle()
        with pytest.raises(UnsafeError, match="restarted by itself"):
            stage.read()
        stage.home()
        assert stage.read() == {"tilt": 0.0, "turn": 0.0}

    def test_without_limit_switches_nothing_mends_a_restart(self):
        with GrblDouble(settings={20: 0, 22: 0}) as double:
            stage = GrblStage(settings_of(double, homing=False), double.clock)
            stage.connect()
            stage.move({"tilt": 20.0})
            double.power_cycle()
            for act in (stage.home, stage.read, lambda: stage.move({"tilt": 1.0})):
                with pytest.raises(UnsafeError, match="restarted by itself"):
                    act()
            with pytest.raises(UnsafeError, match="turn the axes to their zero by hand"):
                stage.home()
            stage.disconnect()

    def test_a_hard_limit_at_rest_is_named(self, stage: GrblStage, double: GrblDouble):
        double.press_limit_switch()
        with pytest.raises(UnsafeError, match=r"ALARM:1, hard limit"):
            stage.move({"tilt": 1.0})

    def test_greetings_that_come_late_are_no_restart(self, double: GrblDouble):
        """A board that the opening of its port restarts hears some of the resets, and greets for each."""
        stage = GrblStage(settings_of(double), double.clock)
        double.banner = "Grbl 1.1h ['$' for help]\r\n\r\nGrbl 1.1h ['$' for help]"
        stage.connect()
        double.banner = "Grbl 1.1h ['$' for help]"
        stage.home()
        assert stage.move({"tilt": 1.0})["tilt"] == 1.0
        stage.disconnect()

    def test_a_stage_beyond_its_limits_is_not_where_it_says(self, stage: GrblStage, double: GrblDouble):
        double.machine.position[1] = -10.0
        for act in (stage.read, lambda: stage.move({"tilt": 1.0})):
            with pytest.raises(DeviceError, match=r"axis tilt is at -90, its limits are -65 and 65.*Home the stage"):
                act()
        stage.home()
        assert stage.read()["tilt"] == 0.0

    def test_a_stage_that_a_pendant_jogs_is_said_to_be_jogged(self, slow_stage: GrblStage, slow: GrblDouble):
        slow.jog("X-20F1200")
        until(slow.waits)
        with pytest.raises(DeviceError, match=r"it is jogged by somebody else\. End the jog"):
            slow_stage.read()


class TestMoving:
    @pytest.mark.parametrize("target", [{"tilt": 65.1}, {"turn": float("nan")}, {"tilt": 1.0, "lift": 0.0}])
    def test_what_is_out_of_limits_is_refused_before_a_byte_is_sent(self, stage, double, target):
        stage.read()
        sent = len(double.received)
        for act in (stage.move, stage.move_duration):
            with pytest.raises(DeviceLimitError):
                act(target)
        assert len(double.received) == sent

    def test_a_line_says_every_mode_itself(self, stage: GrblStage, double: GrblDouble):
        double._modes = {"motion": "G0", "distance": "G91", "units": "G20"}
        double.offset = [7.0, 8.0, 9.0]
        assert stage.move({"tilt": 30.0, "turn": -90.0}) == {"tilt": 30.0, "turn": -90.0}
        assert double.machine.position == pytest.approx([-145.0, -130.0, -1.0])

    def test_work_positions_are_turned_into_those_of_the_machine(self):
        with GrblDouble(settings={10: 0}) as double:
            double.offset = [7.0, 8.0, 9.0]
            stage = GrblStage(settings_of(double), double.clock)
            stage.connect()
            stage.home()
            assert stage.move({"tilt": 30.0}) == {"tilt": 30.0, "turn": 0.0}
            stage.disconnect()

    def test_steps_that_got_lost_are_found(self, stage: GrblStage, double: GrblDouble):
        double.loses_steps = 0.5
        with pytest.raises(DeviceError, match="axis turn is at 19 instead of 20"):
            stage.move({"turn": 20.0})

    def test_a_line_that_is_refused_is_named_with_its_number(self, stage: GrblStage, double: GrblDouble):
        double.refused = {"G21": 20}
        with pytest.raises(DeviceError, match=r"refused 'G21G90.*' with error:20, a G-code command is not supported"):
            stage.move({"turn": 20.0})
        assert stage.read()["turn"] == 0.0

    def test_the_firmwares_own_soft_limit_is_named_and_leads_to_homing(self, stage: GrblStage, double: GrblDouble):
        double.settings[131] = 120.0
        with pytest.raises(DeviceError, match="ALARM:2, soft limit"):
            stage.move({"tilt": 50.0})
        with pytest.raises(DeviceError, match="Home the stage"):
            stage.read()
        double.settings[131] = 200.0
        stage.home()
        assert stage.read()["tilt"] == 0.0


class TestInterfering:
    def test_a_stop_halts_at_once_and_the_position_is_known(self, slow_stage, slow, begin):
        move = moving(begin, slow_stage, slow)
        began, speed = slow.machine.position[0], slow.machine.speed
        slow_stage.stop()
        assert not slow.moves()
        with pytest.raises(DeviceError, match="was stopped"):
            move.result(HANG)
        # From where it was told, no further than braking takes.
        assert 0.0 < slow.machine.position[0] - began <= speed**2 / (2.0 * slow.settings[120]) + 0.05
        here = slow_stage.read()
        assert here["turn"] == pytest.approx((slow.machine.position[0] + 100.0) / 0.5, abs=0.002)
        assert 0.0 < here["turn"] < LONG["turn"]
        assert slow_stage.move({"turn": here["turn"] + 1.0})["turn"] == pytest.approx(here["turn"] + 1.0, abs=0.05)

    def test_a_stop_while_homing_locks_the_stage_until_it_is_homed(self, slow_stage, slow, begin):
        homing = begin.submit(slow_stage.home)
        until(slow.waits)
        assert slow.state == "Home"
        heard = len(slow.received)
        slow_stage.stop()
        assert "\\x18" in slow.received[heard : heard + 2]  # a hold would not be heeded
        with pytest.raises(DeviceError, match=r"ALARM:6|was stopped"):
            homing.result(HANG)
        assert slow.state == "Alarm"
        with pytest.raises(DeviceError, match="Home the stage"):
            slow_stage.read()

    def test_a_stop_ends_the_jog_of_a_pendant(self, slow_stage, slow):
        slow.jog("X-180F2400")
        until(slow.waits)
        slow_stage.stop()
        assert not slow.moves()
        assert slow_stage.read()["turn"] < 0.0

    def test_a_hold_lets_a_move_rest_until_it_is_resumed_and_costs_no_time_limit(self, begin):
        with GrblDouble(pace=10.0) as double:
            clock = hasty(double)
            stage = GrblStage(settings_of(double), clock)
            stage.connect()
            stage.home()
            limit = 1.5 * stage.move_duration(LONG) + 2.0
            double.waits_after = 0.3
            move = moving(begin, stage, double)
            stage.hold()
            until(lambda: double.state == "Hold:0")
            clock.sleep(1.1 * limit)
            assert not move.done()
            assert not double.moves()
            stage.resume()
            assert move.result(HANG)["turn"] == pytest.approx(LONG["turn"], abs=0.05)
            stage.disconnect()

    def test_a_hard_limit_ends_a_move_by_name_and_is_not_tried_again(self, slow_stage, slow, begin):
        move = moving(begin, slow_stage, slow)
        slow.press_limit_switch()
        with pytest.raises(UnsafeError, match="ALARM:1, hard limit"):
            move.result(HANG)
        with pytest.raises(DeviceError, match="its position is unknown"):
            slow_stage.read()

    def test_a_reset_by_somebody_else_is_an_alarm(self, slow_stage, slow, begin):
        move = moving(begin, slow_stage, slow)
        with slow._guard:
            slow._reset()
        with pytest.raises(DeviceError, match="ALARM:3, reset while moving"):
            move.result(HANG)

    def test_an_open_door_ends_a_move(self, slow_stage, slow, begin):
        move = moving(begin, slow_stage, slow)
        slow.open_door()
        with pytest.raises(UnsafeError, match="Close the door"):
            move.result(HANG)

    def test_a_controller_that_restarts_by_itself_is_found_out(self, slow_stage, slow, begin):
        move = moving(begin, slow_stage, slow)
        slow.power_cycle()
        with pytest.raises(DeviceError, match="restarted by itself"):
            move.result(HANG)
        slow.pace = 50.0
        slow_stage.home()
        assert slow_stage.read() == {"tilt": 0.0, "turn": 0.0}

    def test_a_port_that_goes_during_a_move_is_lost_at_once(self, slow_stage, slow, begin):
        move = moving(begin, slow_stage, slow)
        slow.unplug()
        # At once: the clock stands still, so that no limit would end it.
        with pytest.raises(DeviceLostError, match="is gone"):
            move.result(HANG)
        with pytest.raises(DeviceError, match="not connected"):
            slow_stage.read()


def test_a_move_that_is_called_off_is_halted_by_the_stop_that_follows(slow_stage: GrblStage, slow: GrblDouble, begin):
    cancel = Event()
    bounded = BoundedStage(slow_stage, cancel, lambda *_, **__: None)
    move = begin.submit(bounded.move, LONG)
    until(slow.waits)
    cancel.set()
    with pytest.raises(CancelledError):
        move.result(HANG)
    bounded.stop()
    assert not slow.moves()
    cancel.clear()
    assert 0.0 < bounded.read()["turn"] < LONG["turn"]


@pytest.mark.slow
@pytest.mark.parametrize("n_lines", range(14))
@pytest.mark.parametrize(
    "raw", [b"", b"\xff\x00", b"<Idle|MPos:-1", b"<Idle|MPos:-1.000,-100.000,0.000|FS:0,0>\r\n", b"o"]
)
def test_any_line_may_be_spoiled_and_no_position_is_wrong(double: GrblDouble, n_lines: int, raw: bytes):
    stage = GrblStage(settings_of(double), hasty(double))
    stage.connect()
    stage.home()
    double.spoiled_at = (n_lines, raw)
    try:
        assert stage.move({"tilt": 20.0, "turn": -40.0}) == {"tilt": 20.0, "turn": -40.0}
    except DeviceTimeoutError:
        assert not double.moves()
    double.spoiled_at = None
    assert stage.move({"tilt": -20.0, "turn": 10.0}) == stage.read() == {"tilt": -20.0, "turn": 10.0}
    stage.disconnect()


def test_a_stage_that_was_lost_is_connected_again(tmp_path: Path):
    port = tmp_path / "stage"
    with GrblDouble() as double:
        port.symlink_to(double.port)
        stage = GrblStage(settings_of(double, port=str(port)), double.clock)
        stage.connect()
        double.unplug()
        with pytest.raises(DeviceLostError):
            stage.move({"tilt": 1.0})
        with pytest.raises(DeviceError, match=r"cannot open|is gone"):
            stage.connect()
    with GrblDouble() as double:
        port.unlink()
        port.symlink_to(double.port)
        stage.connect()
        stage.home()
        assert stage.move({"tilt": 1.0})["tilt"] == 1.0
        stage.disconnect()


class TestBadWire:
    @pytest.fixture
    def stage(self, double: GrblDouble) -> Iterator[GrblStage]:
        stage = GrblStage(settings_of(double), hasty(double))
        stage.connect()
        stage.home()
        yield stage
        stage.disconnect()

    @pytest.mark.parametrize(
        "garbage",
        [
            b"\xff\x00\x80<Idle|MPos:-1.000,-2.000,0.000",
            b"<Idle|MPos:-10.0",
            b"<Idle|MPos:-10.000,-100.000,0.000|FS:0,0>\r\n",  # lost a digit and looks whole
            b"ALARM\r\nok\r\nerror\r\n",
            b"\n" * 300,
            b"x" * 5000,
        ],
    )
    def test_garbage_in_place_of_a_report_is_never_a_position(self, stage, double, garbage: bytes):
        double.spoiled = {"<Idle": garbage}
        assert stage.read() == {"tilt": 0.0, "turn": 0.0}
        assert not double.spoiled

    def test_garbage_that_nobody_asked_for_does_no_harm(self, stage, double):
        for garbage in (b"\xfe\xff", b"ok\r\nok\r\n", b"<Idle|MPos:1.000,1.000,1.000|FS:0,0>\r\n", b"err"):
            double.say(garbage)
            # It has arrived before anything is asked.
            until(lambda sent=garbage: stage._controller._port._serial.in_waiting == len(sent))
            assert stage.read() == {"tilt": 0.0, "turn": 0.0}

    def test_an_answer_that_gets_lost_is_missed_and_the_next_call_is_in_step(self, stage, double):
        double.spoiled = {"ok": b"o\xff"}
        with pytest.raises(DeviceTimeoutError, match=r"did not answer '' within 2 s"):
            stage.read()
        heard = len(double.received)
        assert stage.move({"tilt": 10.0}) == {"tilt": 10.0, "turn": 0.0}
        # An answer that was late, not lost, must not pass for that to the next line.
        assert "\\x18" in double.received[heard : double.received.index("", heard)]

    def test_lines_that_are_held_back_until_the_next_byte_are_pushed_out(self, stage, double):
        double.holds_back = True
        assert stage.move({"tilt": 10.0}) == stage.read() == {"tilt": 10.0, "turn": 0.0}
        assert stage.move({"tilt": -10.0}) == stage.read() == {"tilt": -10.0, "turn": 0.0}

    def test_slow_answers_are_waited_for(self, stage, double):
        double.delay = 0.01
        assert stage.move({"tilt": 10.0})["tilt"] == 10.0

    def test_a_controller_that_falls_silent_is_a_time_out(self, stage, double):
        double.silent = True
        with pytest.raises(DeviceTimeoutError, match="Look at the cable and the power"):
            stage.read()
        double.silent = False
