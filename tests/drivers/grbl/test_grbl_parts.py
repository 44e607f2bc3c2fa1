import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from drivers.axes.motion import AxisMotion, duration
from drivers.errors import DeviceError, UnsafeError
from drivers.grbl.codes import ALARMS, ERRORS, alarm, bad_state, refusal
from drivers.grbl.firmware import Firmware
from drivers.grbl.report import machine_position, parse_report
from drivers.grbl.settings import GrblSettings
from tests.drivers.grbl.grbl_machine import GrblMachine
from tests.drivers.grbl.grbl_stages import TILT, TURN

_WHOLE = (
    "<Idle|MPos:0.000,-10.000,5.000|FS:0,0>",
    "<Hold:1|WPos:-2.500,0.000,11.000|Bf:15,128|FS:500,8000|Pn:PZ|WCO:0.000,1.551,5.664>",
    "<Alarm:11|MPos:0.000,0.000,0.000,0.000|F:0|Ov:100,100,100|A:SFM>",
)


@pytest.mark.parametrize("line", _WHOLE)
def test_reports_of_the_documentation_are_read(line: str):
    assert parse_report(line) is not None


def test_a_report_tells_state_position_and_offset():
    report = parse_report(_WHOLE[1])
    assert report is not None
    assert (report.state, report.part, report.rests) == ("Hold", 1, False)
    assert report.position == (-2.5, 0.0, 11.0)
    assert report.offset == (0.0, 1.551, 5.664)


@pytest.mark.parametrize("line", _WHOLE)
def test_no_part_of_a_report_is_one(line: str):
    parts = [line[i:j] for i in range(len(line)) for j in range(i + 1, len(line) + 1)]
    assert [part for part in parts if parse_report(part) is not None] == [line]


@pytest.mark.parametrize("whole", _WHOLE)
@pytest.mark.parametrize("torn", _WHOLE)
def test_half_a_report_before_another_is_none(torn: str, whole: str):
    assert not any(parse_report(torn[:n] + whole) for n in range(1, len(torn) + 1))


@settings(max_examples=50, deadline=None)
@given(st.text(max_size=40))
def test_garbage_is_no_report(text: str):
    assert parse_report(f"<Idle|MPos:0.000,-10.000,5.0{text}") is None or text.startswith("00")


def test_a_work_position_is_none_of_the_machine_until_the_offset_is_known():
    report = parse_report("<Idle|WPos:1.000,2.000,3.000|FS:0,0>")
    assert report is not None
    assert machine_position(report, None) is None
    assert machine_position(report, (10.0, 20.0, 30.0)) == (11.0, 22.0, 33.0)


# The numbers that the documentation of GRBL 1.1 lists.
@pytest.mark.parametrize("number", range(1, 10))
def test_every_alarm_has_a_name_and_a_mend(number: int):
    what, next_ = ALARMS[number]
    assert str(alarm(number)) == f"the controller raised ALARM:{number}, {what}. {next_}."


@pytest.mark.parametrize("number", [*range(1, 18), *range(20, 39)])
def test_every_error_has_a_name_and_a_mend(number: int):
    what, next_ = ERRORS[number]
    assert str(refusal(number, "$H")) == f"the controller refused '$H' with error:{number}, {what}. {next_}."


def test_numbers_that_no_documentation_knows_are_named_all_the_same():
    assert "ALARM:77" in str(alarm(77))
    assert "error:99" in str(refusal(99, "G1"))


def test_what_needs_somebody_to_look_is_not_tried_again():
    assert [n for n in ALARMS if isinstance(alarm(n), UnsafeError)] == [1, 7, 8, 9, 10, 12, 15, 16, 17, 18]
    assert isinstance(bad_state("Door"), UnsafeError)


@settings(max_examples=20, deadline=None)
@given(
    way=st.tuples(*[st.floats(-180.0, 180.0)] * 3),
    rates=st.tuples(*[st.floats(600.0, 6000.0)] * 3),
    accelerations=st.tuples(*[st.floats(20.0, 400.0)] * 3),
)
def test_a_motion_takes_as_long_as_its_steps(way, rates, accelerations):
    numbers = {110 + i: rate for i, rate in enumerate(rates)} | {120 + i: a for i, a in enumerate(accelerations)}
    machine = GrblMachine(numbers)
    machine.queue.append((list(way), 1e9))
    n_steps = 0
    while machine.queue:
        machine.pass_time(0.01)
        n_steps += 1
    motions = [AxisMotion(w, rate / 60.0, a) for w, rate, a in zip(way, rates, accelerations, strict=True)]
    assert 0.01 * n_steps == pytest.approx(duration(motions), rel=0.01, abs=0.03)


def test_no_way_takes_no_time():
    assert duration([AxisMotion(0.0, 1.0, 1.0)]) == 0.0


@given(st.floats(-65.0, 65.0))
def test_machine_units_and_positions_turn_into_each_other(position: float):
    for axis in (TILT, TURN):
        there = axis.machine_from_position(position)
        assert axis.position_from_native(there) == pytest.approx(position, abs=0.0006 / abs(axis.scale))


def test_travel_is_negative_unless_homing_sets_the_origin_towards_it():
    values = {23: 0b10, 130: 200.0, 131: 100.0}
    assert Firmware(values, "", "", "V").travel(TILT) == (-100.0, 0.0)
    assert Firmware(values, "", "", "VZ").travel(TILT) == (0.0, 100.0)
    assert Firmware(values, "", "", "VZ").travel(TURN) == (-200.0, 0.0)


def test_build_and_label_are_told_apart():
    firmware = Firmware.from_lines(["$13=0", "$110=500.000", "ok"], ["[VER:1.1h.20190830:bench 7]", "[OPT:VZ,15,128]"])
    assert firmware.values == {13: 0.0, 110: 500.0}
    assert (firmware.build, firmware.label, firmware.options) == ("1.1h.20190830", "bench 7", "VZ")


def test_a_controller_that_lost_its_settings_is_found_by_its_steps():
    values = dict.fromkeys((*range(100, 103), *range(110, 113), *range(120, 123), *range(130, 133)), 500.0)
    values |= {13: 0.0, 20: 0.0, 22: 1.0, 24: 25.0, 25: 500.0, 27: 1.0}
    axis = TILT.model_copy(update={"steps_per_unit": 88.889})
    stage = GrblSettings(port="/dev/x", axes=(axis,))
    right = Firmware(values | {100 + axis.i_letter: 88.889}, "1.1h", "", "V")
    right.check(stage)
    lost = Firmware(values | {100 + axis.i_letter: 250.0}, "1.1h", "", "V")
    with pytest.raises(DeviceError, match=rf"\${100 + axis.i_letter} is 250, rig.toml has 88.889 as steps_per_unit"):
        lost.check(stage)
    assert f"steps of axis {axis.name}" in {setting.name for setting in right.read_back((axis,))}


@pytest.mark.parametrize(
    ("line", "n_axes", "homed", "override"),
    [
        ("<Idle|MPos:0.000,0.000,0.000,0.000,0.000,0.000,0.000,0.000|FS:0,0>", 8, None, None),
        ("<Idle|WPos:0.000,0.000,0.000|Bf:35,1023|Ln:99|FS:0,0|WCO:0.000,0.000,0.000|H:1,7|T:0>", 3, True, None),
        ("<Alarm:11|MPos:0.000,0.000,0.000|FS:0,0|Ov:50,100,100|H:0|P0:1|FW:grblHAL>", 3, False, 50),
    ],
)
def test_reports_of_other_boards_are_read(line: str, n_axes: int, homed: bool | None, override: int | None):
    report = parse_report(line)
    assert report is not None
    assert (len(report.position), report.homed, report.feed_override) == (n_axes, homed, override)


@pytest.mark.parametrize("number", range(10, 19))
def test_alarms_of_grblhal_have_a_name_too(number: int):
    assert "not in the documentation" not in str(alarm(number))


def test_an_emergency_stop_is_unsafe_by_alarm_and_by_error():
    assert isinstance(alarm(10), UnsafeError)
    assert isinstance(refusal(50, "G0"), UnsafeError)


def test_an_axis_without_ends_has_no_travel_to_stay_in():
    values = {20: 1.0, 100: 100.0, 110: 500.0, 120: 50.0, 130: 0.0}
    assert list(Firmware(values, "", "", "")._beyond_travel(TURN)) == []
