import errno
import os
import sys
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from importlib import import_module
from pathlib import Path
from threading import Event

import pytest
import serial
from pydantic import ValidationError

from drivers.device_settings import settings_from_table
from drivers.driver import Driver
from drivers.errors import (
    DeviceError,
    DeviceLostError,
    DeviceTimeoutError,
    DriverNotFoundError,
    UnsafeError,
)
from drivers.zaber import link as link_module
from drivers.zaber.driver import DRIVER
from drivers.zaber.flags import BLOCKING, NOTES, blocked
from drivers.zaber.settings import ZaberSettings
from drivers.zaber.stage import ZaberStage
from instrument.rig.bounded import BoundedStage
from tests.drivers.device_page import toml_of_page
from tests.drivers.double_clock import HANG, HastyClock, until
from tests.drivers.zaber.zaber_double import ZaberDouble
from tests.drivers.zaber.zaber_stages import TILT, TURN, settings_of, skip_without_zaber

skip_without_zaber()

LONG = {"turn": 170.0}


@pytest.fixture
def double() -> Iterator[ZaberDouble]:
    with ZaberDouble() as double:
        yield double


@pytest.fixture
def stage(double: ZaberDouble) -> Iterator[ZaberStage]:
    stage = ZaberStage(settings_of(double), double.clock)
    stage.connect()
    yield stage
    # What is unplugged cannot be stopped.
    if stage._drive is not None:
        stage.disconnect()


@pytest.fixture
def slow() -> Iterator[ZaberDouble]:
    """Devices that a test can interfere with while they move."""
    with ZaberDouble(pace=4.0) as double:
        yield double


def hasty(double: ZaberDouble) -> HastyClock:
    return HastyClock(double.clock, 200.0)


@pytest.fixture
def slow_stage(slow: ZaberDouble) -> Iterator[ZaberStage]:
    stage = ZaberStage(settings_of(slow), slow.clock)
    stage.connect()
    yield stage
    if stage._drive is not None:
        stage.disconnect()


@pytest.fixture
def begin() -> Iterator[ThreadPoolExecutor]:
    with ThreadPoolExecutor(1) as executor:
        yield executor


def moving(executor: ThreadPoolExecutor, act: Callable[[], object], double: ZaberDouble) -> Future[object]:
    """Begin what moves an axis; the devices wait on the way until they are told to stop."""
    double.waits_after = double.time + 0.3
    future = executor.submit(act)
    until(double.waits)
    return future


def is_free(port: str) -> bool:
    serial.Serial(port, exclusive=True).close()
    return True


class TestConnecting:
    def test_tells_what_the_devices_are(self, stage: ZaberStage):
        described = stage.describe()
        assert (described.make, described.model) == ("Zaber", "device id 50081+30342")
        assert (described.serial_number, described.firmware) == ("41234+56789", "7.38+7.38")
        assert [str(setting) for setting in described.settings] == [
            "tilt_max_speed 30 deg/s",
            "turn_max_speed 60 deg/s",
        ]

    def test_changes_no_setting_of_a_device(self, double: ZaberDouble, stage: ZaberStage):
        stage.home()
        stage.move({"tilt": 5.0})
        assert double.did("get")
        assert not double.did("set")

    def test_brings_a_stage_that_moves_to_rest(self, slow: ZaberDouble):
        slow.waits_after = 0.3
        slow.axes[2, 2].move(slow.time, 90_000.0)
        stage = ZaberStage(settings_of(slow), slow.clock)
        stage.connect()
        assert not slow.moves()
        assert 0.0 < stage.read()["turn"] < 180.0
        stage.disconnect()

    def test_a_port_that_is_not_there_is_named_with_those_that_are(self, double: ZaberDouble):
        with pytest.raises(DeviceError, match=r"cannot open /dev/none. There is no such port.*Ports here: "):
            ZaberStage(settings_of(double, port="/dev/none"), double.clock).connect()

    @pytest.mark.parametrize(("number", "mend"), [(errno.EACCES, "usermod -aG dialout"), (errno.EBUSY, "Close it")])
    def test_a_port_that_may_not_be_opened_comes_with_its_mend(self, double, monkeypatch, number: int, mend: str):
        def refuse(*_):
            raise OSError(number, os.strerror(number))

        monkeypatch.setattr("serial.serialposix.os.open", refuse)
        with pytest.raises(DeviceError, match=mend):
            ZaberStage(settings_of(double), double.clock).connect()

    def test_a_port_that_another_program_uses_is_left_to_it(self, double: ZaberDouble):
        with (
            serial.Serial(double.port, exclusive=True),
            pytest.raises(DeviceError, match="Another program uses the port"),
        ):
            ZaberStage(settings_of(double), double.clock).connect()
        assert not double.received

    def test_a_port_that_another_stage_uses_is_left_to_it(self, double: ZaberDouble, stage: ZaberStage):
        with pytest.raises(DeviceError, match="Another program uses the port"):
            ZaberStage(settings_of(double), double.clock).connect()
        assert stage.move({"tilt": 1.0})["tilt"] == pytest.approx(1.0)

    def test_a_file_is_no_port(self, double: ZaberDouble, tmp_path: Path):
        path = tmp_path / "port"
        path.touch()
        with pytest.raises(DeviceError, match="That is no serial port"):
            ZaberStage(settings_of(double, port=str(path)), double.clock).connect()

    @pytest.mark.parametrize("attribute", ["silent", "speaks_grbl"])
    def test_whatever_is_no_zaber_device_is_told(self, double: ZaberDouble, attribute: str, monkeypatch):
        monkeypatch.setattr(link_module, "_ANSWER_LIMIT_MS", 50)
        setattr(double, attribute, True)
        with pytest.raises(DeviceTimeoutError, match=r"nothing at .* answers as a Zaber device .* at 115200 baud"):
            ZaberStage(settings_of(double), double.clock).connect()
        assert is_free(double.port)

    def test_a_device_that_is_not_in_the_chain_is_named_with_those_that_are(self, double: ZaberDouble, monkeypatch):
        monkeypatch.setattr(link_module, "_ANSWER_LIMIT_MS", 1000)
        axes = [{**TILT, "device_address": 7}, TURN]
        with pytest.raises(DeviceError, match=r"no device 7 in the chain at .*; found: 1, 2\. Correct device_address"):
            ZaberStage(settings_of(double, axes=axes), double.clock).connect()
        assert is_free(double.port)

    def test_a_device_that_answers_late_is_not_missed(self, double: ZaberDouble, monkeypatch):
        monkeypatch.setattr(link_module, "_ANSWER_LIMIT_MS", 1000)
        double.unanswered.add("/2 0 ")
        stage = ZaberStage(settings_of(double), double.clock)
        stage.connect()
        assert not double.unanswered
        assert stage.read() == {"tilt": 20.0, "turn": 0.0}
        stage.disconnect()

    def test_an_axis_that_its_device_does_not_have_is_named(self, double: ZaberDouble):
        axes = [{**TILT, "axis_number": 2}, {**TURN, "axis_number": 3}]
        with pytest.raises(DeviceError) as caught:
            ZaberStage(settings_of(double, axes=axes), double.clock).connect()
        assert "axis tilt: device 1 has no axis 2, it has 1" in str(caught.value)
        assert "axis turn: device 2 has no axis 3, it has 2" in str(caught.value)

    def test_all_that_does_not_fit_is_said_at_once(self, double: ZaberDouble):
        double.axes[1, 1].settings.update({"limit.min": -10_000.0, "maxspeed": 0.0})
        axes = [TILT, {**TURN, "tolerance": 1e-4}]
        with pytest.raises(DeviceError) as caught:
            ZaberStage(settings_of(double, axes=axes), double.clock).connect()
        for part in (
            "axis tilt: soft_limits are -45000 to 85000 in its units and the device's",
            "axis tilt: maxspeed is 0",
            "axis turn: tolerance 0.0001 is finer than a microstep; allowed from 0.001",
        ):
            assert part in str(caught.value)
        assert is_free(double.port)

    def test_needs_its_library_and_says_so(self, double: ZaberDouble, monkeypatch):
        monkeypatch.setitem(sys.modules, "zaber_motion", None)
        with pytest.raises(DriverNotFoundError, match=r'pip install "halfangle\[zaber\]"'):
            ZaberStage(settings_of(double), double.clock).connect()


class TestMoving:
    def test_turns_in_the_sense_of_its_scale_from_its_zero(self, double: ZaberDouble, stage: ZaberStage):
        stage.move({"tilt": 10.0, "turn": 90.0})
        assert double.did("move abs") == ["move abs 10000", "move abs 45000"]
        assert double.axes[1, 1].position(double.time) == pytest.approx(10_000.0)
        assert stage.read() == {"tilt": 10.0, "turn": 90.0}

    @pytest.mark.parametrize("flag", ["WR", "WH"])
    def test_an_axis_without_reference_is_to_be_homed_first(self, double: ZaberDouble, stage: ZaberStage, flag: str):
        double.axes[2, 2].flags.add(flag)
        with pytest.raises(DeviceError, match=rf"axis turn reports {flag}: .*Home the stage"):
            stage.move({"tilt": 1.0})
        with pytest.raises(DeviceError, match="Home the stage"):
            stage.read()
        assert not double.did("move")
        assert stage.move_duration({"turn": 90.0}) > 1.0
        stage.home()
        assert stage.move({"turn": 1.0})["turn"] == pytest.approx(1.0)

    def test_a_stall_is_told_stops_all_and_is_forgotten_by_homing(self, slow: ZaberDouble, slow_stage: ZaberStage):
        slow.axes[1, 1].stalls = True
        slow.waits_after = slow.time + 0.7  # tilt has stalled, turn is half way
        with pytest.raises(DeviceError, match="axis tilt reports FS: it stalled and stopped") as caught:
            slow_stage.move({"tilt": 25.0, "turn": 100.0})
        assert not isinstance(caught.value, UnsafeError)
        assert not slow.moves()
        assert slow.axes[2, 2].position(slow.time) < 50_000.0
        with pytest.raises(DeviceError, match="FS"):
            slow_stage.move({"tilt": 0.0})
        slow_stage.home()
        assert slow_stage.move({"tilt": 1.0})["tilt"] == pytest.approx(1.0)

    def test_a_driver_that_is_disabled_is_not_enabled_by_us(self, double: ZaberDouble, stage: ZaberStage):
        double.axes[1, 1].flags.add("FD")
        with pytest.raises(DeviceError, match=r"axis tilt reports FD: its driver is disabled.*driver enable"):
            stage.move({"tilt": 1.0})
        with pytest.raises(DeviceError, match="DRIVERDISABLED"):
            stage.home()
        assert not double.did("driver")

    def test_what_somebody_has_to_look_at_is_unsafe(self, double: ZaberDouble, stage: ZaberStage):
        double.axes[1, 1].flags |= {"FM", "WR"}
        double.axes[2, 2].flags.add("WR")
        with pytest.raises(UnsafeError, match=r"FM: the motor is too hot.*axis turn reports WR"):
            stage.move({"tilt": 1.0})

    def test_notes_hinder_nothing(self, double: ZaberDouble, stage: ZaberStage):
        double.axes[1, 1].flags |= {"NI", "WT"}
        assert stage.move({"tilt": 1.0})["tilt"] == pytest.approx(1.0)

    def test_a_refusal_comes_with_the_command_and_its_reason(self, double: ZaberDouble, stage: ZaberStage):
        double.refused["move"] = "PARKED"
        with pytest.raises(DeviceError, match=r'rejected command "move abs 19000" with PARKED'):
            stage.move({"tilt": 1.0})
        assert double.did("stop")

    def test_lost_steps_are_found(self, double: ZaberDouble, stage: ZaberStage):
        double.axes[2, 2].loses_steps = 500.0
        with pytest.raises(DeviceError, match=r"axis turn is at 89 instead of 90 \(flags: none\).*Home it"):
            stage.move({"turn": 90.0})

    def test_a_move_that_does_not_end_is_given_up_and_stopped(self, slow: ZaberDouble):
        stage = ZaberStage(settings_of(slow), hasty(slow))
        stage.connect()
        slow.waits_after = 0.3
        with pytest.raises(DeviceTimeoutError, match=r"axes turn still move after \d"):
            stage.move(LONG)
        until(lambda: not slow.moves())
        assert slow.received.index("move abs 85000") < len(slow.received) - 1 - slow.received[::-1].index("stop")
        stage.disconnect()


class TestHoming:
    def test_goes_to_the_zero_of_the_stage_not_of_the_device(self, double: ZaberDouble, stage: ZaberStage):
        stage.home()
        assert double.axes[1, 1].position(double.time) == pytest.approx(20_000.0)

    def test_older_firmware_has_one_speed_for_all(self, double: ZaberDouble):
        for axis in double.axes.values():
            del axis.settings["limit.approach.maxspeed"]
        stage = ZaberStage(settings_of(double), double.clock)
        stage.connect()
        stage.home()
        assert stage.read() == {"tilt": 0.0, "turn": 0.0}
        stage.disconnect()

    def test_a_sensor_that_is_not_found_ends_it(self, double: ZaberDouble):
        double.axes[1, 1].sensor_is_missing = True
        stage = ZaberStage(settings_of(double), hasty(double))
        stage.connect()
        with pytest.raises(DeviceTimeoutError, match="axes tilt, turn still move"):
            stage.home()
        double.axes[1, 1].sensor_is_missing = False
        stage.disconnect()

    def test_can_be_stopped(self, slow: ZaberDouble, slow_stage: ZaberStage, begin: ThreadPoolExecutor):
        slow_stage.move({"turn": 30.0})
        homing = moving(begin, slow_stage.home, slow)
        slow_stage.stop()
        with pytest.raises(DeviceError, match="the motion was stopped"):
            homing.result(HANG)
        assert not slow.moves()


class TestStopping:
    def test_halts_a_move_of_another_thread_and_its_caller_is_told(self, slow, slow_stage, begin):
        move = moving(begin, lambda: slow_stage.move(LONG), slow)
        axis = slow.axes[2, 2]
        began, speed = axis.position(slow.time), axis.profile.speed(slow.time)
        slow_stage.stop()
        assert not slow.moves()
        with pytest.raises(DeviceError, match="the motion was stopped"):
            move.result(HANG)
        # From where it was told, no further than braking takes, and a microstep.
        assert 0.0 < axis.position(slow.time) - began <= speed**2 / (2.0 * axis.profile.acceleration) + 1.0
        assert slow_stage.read()["turn"] < 170.0
        assert slow_stage.move({"turn": 10.0})["turn"] == pytest.approx(10.0)

    def test_bounded_calls_can_be_called_off(self, slow: ZaberDouble, slow_stage: ZaberStage):
        notes: list[str] = []
        bounded = BoundedStage(slow_stage, Event(), lambda what, **_: notes.append(what))
        assert bounded.move({"tilt": 15.0})["tilt"] == pytest.approx(15.0)
        bounded.stop()
        assert notes == ["move"]


class TestABadWire:
    def test_a_port_that_goes_away_in_a_move_is_said_at_once(self, slow, slow_stage, begin):
        move = moving(begin, lambda: slow_stage.move(LONG), slow)
        slow.unplug()
        began = slow.clock.now()
        with pytest.raises(DeviceLostError, match=r"is gone .*connect again"):
            move.result(HANG)
        # When it was looked at next.
        assert slow.clock.now() - began < 0.1
        with pytest.raises(DeviceError, match="not connected"):
            slow_stage.read()

    def test_a_port_that_goes_away_while_an_answer_is_due_is_gone_too(self, double, begin):
        stage = ZaberStage(settings_of(double), double.clock)
        stage.connect()
        double.silent = True
        n_heard = double.n_heard
        read = begin.submit(stage.read)
        until(lambda: double.n_heard > n_heard)
        double.unplug()
        with pytest.raises(DeviceLostError, match="is gone"):
            read.result(HANG)

    def test_a_reply_with_a_wrong_checksum_is_no_position(self, double: ZaberDouble, monkeypatch):
        stage = ZaberStage(settings_of(double), double.clock)
        stage.connect()
        double.n_spoiled = 1
        with monkeypatch.context() as patch:
            patch.setattr(link_module, "_ANSWER_LIMIT_MS", 100)
            with pytest.raises(DeviceTimeoutError, match="no answer from device 1 to 'get pos'"):
                stage.read()
        assert stage.read() == {"tilt": 20.0, "turn": 0.0}
        stage.disconnect()

    def test_it_is_connected_again_after_it_was_gone(self, double: ZaberDouble):
        stage = ZaberStage(settings_of(double), double.clock)
        for _ in range(2):
            stage.connect()
            stage.move({"tilt": 1.0})
            stage.disconnect()
        assert is_free(double.port)


class TestSettings:
    def test_all_that_cannot_be_is_said_with_its_place(self, double: ZaberDouble):
        bad = {**TILT, "vector": [1.0, 1.0, 0.0], "soft_limits": [10.0, 20.0], "scale": 0.0}
        with pytest.raises(ValidationError) as caught:
            settings_of(double, axes=[bad, {**TURN, "kind": "spiral"}], baud_rate=1)
        text = str(caught.value)
        for part in (
            "vector has length 1.41421",
            "0, where the axis is after homing",
            "scale is 0",
            "kind",
            "baud_rate",
        ):
            assert part in text

    def test_the_page_shows_a_table_that_the_driver_takes(self):
        settings = settings_from_table(ZaberSettings, toml_of_page('driver = "zaber"')["stage"]["device"])
        assert [axis.place for axis in settings.axes] == [(1, 1), (2, 1)]

    def test_two_axes_cannot_be_one(self, double: ZaberDouble):
        with pytest.raises(ValidationError, match=r"the name of two axes is tilt; two axes are axis 1 of device 1"):
            settings_of(double, axes=[TILT, TILT])

    def test_the_driver_opens_what_its_settings_say(self, double: ZaberDouble):
        table = {"port": double.port, "axes": [TILT, TURN]}
        stage = DRIVER.open(settings_from_table(ZaberSettings, table), {"serial_number": None})
        stage.connect()
        assert stage.read() == {"tilt": 20.0, "turn": 0.0}
        stage.disconnect()
        assert isinstance(DRIVER, Driver)
        assert (DRIVER.kind, list(DRIVER.find())) == ("stage", [])


class TestFlags:
    def test_every_flag_of_the_library_is_known(self):
        flags = import_module("zaber_motion.ascii").WarningFlags
        names = {value for key, value in vars(flags).items() if key.isupper()}
        assert names == set(BLOCKING) | set(NOTES)

    def test_a_fault_that_is_not_known_hinders_too(self):
        assert "F9" in str(blocked("tilt", ["NI", "F9"]))
        assert blocked("tilt", ["NI"]) is None


class TestTheDouble:
    @pytest.mark.parametrize(
        ("sent", "answer"),
        [
            (b"/1 1 07 get pos:2A\n", b"@01 1 07 OK IDLE -- 0:"),
            (b"/1 3 07 get pos:28\n", b"@01 3 07 RJ IDLE -- BADAXIS:"),
            (b"/1 1 07 get nothing:", b"@01 1 07 RJ IDLE -- BADCOMMAND:"),
            (b"/1 1 07 move abs 1.5:", b"@01 1 07 RJ IDLE -- BADDATA:"),
            (b"/1 1 07 move abs 200001:", b"@01 1 07 RJ IDLE -- BADDATA:"),
        ],
    )
    def test_answers_as_the_manual_says(self, double: ZaberDouble, sent: bytes, answer: bytes):
        with serial.Serial(double.port, timeout=HANG) as port:
            body = sent.split(b":")[0]
            port.write(body + f":{-sum(body[1:]) & 0xFF:02X}\n".encode())
            got = port.readline()
        assert got.startswith(answer)
        # All bytes after the first, the checksum included, add up to nothing.
        text, checksum = got.strip()[1:].split(b":")
        assert (sum(text) + int(checksum, 16)) % 256 == 0

    def test_heeds_nothing_without_a_right_checksum(self, double: ZaberDouble):
        with serial.Serial(double.port, timeout=HANG) as port:
            port.write(b"/1 1 07 get pos:00\n/1 1 07 get pos\n/1 1 08 get pos:24\n")
            # The first answer is that to what was right.
            assert port.readline().startswith(b"@01 1 08 OK IDLE -- 0:")
