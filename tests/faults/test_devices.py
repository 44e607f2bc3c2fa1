"""What becomes of a capture when a device goes wrong, fault by fault."""

from __future__ import annotations

from pathlib import Path

import pytest

from drivers.simulated.faults import Fault
from instrument.session.session import Session
from protocols.capture.engine import Finish
from tests.faults import bench
from tests.faults.record import FaultRecord
from tests.verifying import verify_session

ALWAYS = 0
NEVER_BACK = 1e9
# Triggers before the first pose: two darks of each of three exposures. A pose has three and one that looks for dark.
FIRST_POSE, SECOND_POSE = 6, 10

fault = pytest.mark.fault


def text(of: Fault) -> str:
    where = f"{of.device}.{of.call}"
    how_often = "from then on" if of.repeats == ALWAYS else "once" if of.repeats == 1 else f"{of.repeats} times"
    back = f"; back at the {of.value:g}. try to connect" if 1 <= of.value < NEVER_BACK else ""
    gone = "; it does not come back" if of.value == NEVER_BACK else ""
    return f"`{of.effect}` at {where} {of.at}, {how_often}{back}{gone}"


def short(message: str) -> str:
    """The first sentence of a message, for the page."""
    return message.split(". ", maxsplit=1)[0].replace("|", "/")


MENDED = [
    pytest.param(Fault("camera", "lost", "trigger", 8, value=2), marks=fault(1), id="1 unplugged"),
    pytest.param(Fault("camera", "no_answer", "trigger", 8), marks=fault(2), id="2 no frame"),
    pytest.param(Fault("camera", "dropped_frame", "trigger", 8), marks=fault(3), id="3 dropped"),
    pytest.param(Fault("camera", "repeated_frame", "trigger", 8), marks=fault(4), id="4 twice"),
    pytest.param(Fault("camera", "stale_frame", "trigger", 8), marks=fault(5), id="5 stale"),
    pytest.param(Fault("camera", "torn_frame", "trigger", 8), marks=fault(6), id="6 torn"),
    pytest.param(Fault("light", "stays_dark", "on", 1), marks=fault(9), id="9 stays dark"),
    pytest.param(Fault("light", "stays_on", "off", 4), marks=fault(10), id="10 stays on"),
    pytest.param(Fault("stage", "stall", "move", 1), marks=fault(12), id="12 stalls"),
    pytest.param(Fault("stage", "slip", "move", 1), marks=fault(12), id="12 slips"),
    pytest.param(Fault("stage", "alarm", "move", 1), marks=fault(13), id="13 alarm"),
    pytest.param(Fault("stage", "garbage", "read", 1), marks=fault(14), id="14 garbage of the stage"),
    pytest.param(Fault("light", "garbage", "read", 4), marks=fault(14), id="14 garbage of the light"),
    pytest.param(Fault("stage", "lost", "move", 1, value=3), marks=fault(15), id="15 port gone"),
]


@pytest.mark.parametrize("spoil", MENDED)
def test_what_a_device_does_once_costs_an_attempt_and_no_data(
    tmp_path: Path, whole: dict[str, object], fault_record: FaultRecord, spoil: Fault
) -> None:
    run = bench.run(tmp_path / "s.h5", spoil)
    assert run.struck
    assert run.finish is Finish.COMPLETE
    assert run.is_dark
    assert list(verify_session(run.path)) == []
    assert bench.content(run.path) == whole
    # The light is told to go off as soon as the fault is seen; only a light that does not obey takes longer.
    assert run.light_after is None or run.light_after < 1.01
    with Session(run.path) as session:
        repeated = any('"event": "repeated"' in event for event in session.events)
        assert repeated == (spoil.effect != "stays_on")
    how = "the pose is taken again" if repeated else "told again, it obeys"
    fault_record.row(text(spoil), f"{how}; complete, the same frames", run.light_after)


GIVEN_UP = [
    pytest.param(Fault("camera", "lost", "trigger", 8, value=NEVER_BACK), Finish.PAUSED, marks=fault(1), id="1 gone"),
    pytest.param(Fault("camera", "no_answer", "trigger", 8, repeats=ALWAYS), Finish.PAUSED, marks=fault(2), id="2"),
    pytest.param(Fault("camera", "torn_frame", "trigger", 8, repeats=ALWAYS), Finish.FAULT, marks=fault(6), id="6"),
    pytest.param(Fault("light", "stays_dark", "on", 1, repeats=ALWAYS), Finish.FAULT, marks=fault(9), id="9 dark"),
    pytest.param(Fault("light", "dead", "on", 1, repeats=ALWAYS), Finish.FAULT, marks=fault(9), id="9 dead"),
    pytest.param(Fault("stage", "stall", "move", 1, repeats=ALWAYS), Finish.PAUSED, marks=fault(12), id="12"),
    pytest.param(Fault("stage", "alarm", "move", 1, repeats=ALWAYS), Finish.FAULT, marks=fault(13), id="13"),
    pytest.param(Fault("stage", "garbage", "read", 1, repeats=ALWAYS), Finish.FAULT, marks=fault(14), id="14"),
]


@pytest.mark.parametrize(("spoil", "finish"), GIVEN_UP)
def test_what_a_device_goes_on_doing_ends_the_capture_dark_and_resumable(
    tmp_path: Path, whole: dict[str, object], fault_record: FaultRecord, spoil: Fault, finish: Finish
) -> None:
    run = bench.run(tmp_path / "s.h5", spoil)
    assert run.finish is finish
    assert run.is_dark
    assert "The light is off" in run.message
    assert f"Go on with: halfangle resume {run.path}" in run.message
    assert list(verify_session(run.path)) == []
    assert bench.only_whole_poses(run.path)
    left = bench.n_complete(run.path)
    assert bench.resumed(run.path) == whole
    what = f"{finish.value} with {left} of 3 poses: {short(run.message)}; resumed to the same frames"
    fault_record.row(text(spoil), what, run.light_after)


@fault(2)
@pytest.mark.usefixtures("impatient")
@pytest.mark.parametrize(
    ("device", "call", "at"), [("camera", "trigger", 8), ("light", "on", 1), ("light", "read", 4), ("stage", "read", 1)]
)
def test_a_driver_that_never_returns_is_given_up_in_time(
    tmp_path: Path, whole: dict[str, object], fault_record: FaultRecord, device: str, call: str, at: int
) -> None:
    spoil = Fault(device, "hang", call, at)
    run = bench.run(tmp_path / "s.h5", spoil)
    assert run.finish is Finish.COMPLETE
    assert run.is_dark
    assert bench.content(run.path) == whole
    fault_record.row(
        text(spoil), "the call is given up, the device connected anew, the pose taken again", run.light_after
    )


@fault(7)
def test_a_pose_that_clips_is_flagged(tmp_path: Path, fault_record: FaultRecord) -> None:
    spoil = Fault("camera", "clipped_frame", "trigger", SECOND_POSE, repeats=3)
    run = bench.run(tmp_path / "s.h5", spoil)
    assert run.finish is Finish.COMPLETE
    assert "pose 1: 100.0% of the shortest exposure clips. Add a shorter exposure" in run.warnings[0]
    with Session(run.path) as session:
        assert session.saturated_fraction[1, 0] == 1.0
        assert any('"event": "clipped", "pose": 1' in event for event in session.events)
    fault_record.row(
        text(spoil), "`when_clipped = flag`: warned live, flagged in the journal, complete", run.light_after
    )


@fault(7)
def test_a_pose_that_clips_pauses_where_the_protocol_says_so(tmp_path: Path, fault_record: FaultRecord) -> None:
    spoil = Fault("camera", "clipped_frame", "trigger", SECOND_POSE, repeats=3)
    run = bench.run(tmp_path / "s.h5", spoil, when_clipped="pause")
    assert run.finish is Finish.PAUSED
    assert "the protocol says to pause there" in run.message
    assert bench.n_complete(run.path) == 2
    fault_record.row(text(spoil), "`when_clipped = pause`: paused after that pose", run.light_after)


@fault(7)
def test_a_pose_that_clips_gets_a_shorter_exposure_where_the_protocol_says_so(
    tmp_path: Path, fault_record: FaultRecord
) -> None:
    # With the spare exposure there are eight darks, and the first pose takes four frames.
    spoil = Fault("camera", "clipped_frame", "trigger", 8 + 4, repeats=3)
    run = bench.run(tmp_path / "s.h5", spoil, when_clipped="shorter")
    assert run.finish is Finish.COMPLETE
    with Session(run.path) as session:
        assert session.exposure_times.tolist() == [0.0005, 0.002, 0.01, 0.05]
        assert session.frame_ok[:, 0].tolist() == [False, True, False]
        assert session.frame_ok[:, 1:].all()
        assert not session.frames(0)[0].any()
    assert list(verify_session(run.path)) == []
    fault_record.row(
        text(spoil), "`when_clipped = shorter`: a spare exposure is taken in its own slot", run.light_after
    )


@fault(8)
def test_a_lens_cap_ends_the_capture_with_the_cause_and_no_pose(
    tmp_path: Path, whole: dict[str, object], fault_record: FaultRecord
) -> None:
    spoil = Fault("camera", "black_frame", "trigger", FIRST_POSE, repeats=ALWAYS)
    run = bench.run(tmp_path / "s.h5", spoil)
    assert "the picture is black though the light's own monitor sees it shine. Is the lens cap on?" in run.message
    assert bench.n_complete(run.path) == 0
    assert bench.resumed(run.path) == whole
    fault_record.row(text(spoil), "fault at the first pose, not repeated; no dark pose is kept", run.light_after)


@fault(10)
@pytest.mark.parametrize("effect", ["stays_on", "stuck"])
def test_a_light_that_does_not_go_off_is_a_loud_fault_and_its_lease_ends_it(
    tmp_path: Path, whole: dict[str, object], fault_record: FaultRecord, effect: str
) -> None:
    spoil = Fault("light", effect, "off", 4, repeats=ALWAYS)
    run = bench.run(tmp_path / "s.h5", spoil)
    assert run.finish is Finish.FAULT
    assert ("NOT SAFE" in run.message) == (effect == "stays_on")
    assert "Switch it off by hand" in run.message
    world = run.world
    assert isinstance(world.clock.now(), float)
    # The lease of the bracket: its exposures and two seconds for each.
    world.clock.sleep(6.1)
    assert run.is_dark
    assert bench.resumed(run.path) == whole
    how = "its own word" if effect == "stays_on" else "the picture after the bracket"
    fault_record.row(text(spoil), f"told twice, then a loud fault, by {how}; the lease ends it", 6.06)


@fault(11)
def test_a_light_that_drifts_is_flagged(tmp_path: Path, fault_record: FaultRecord) -> None:
    spoil = Fault("light", "drift", "on", 1, value=0.2)
    run = bench.run(tmp_path / "s.h5", spoil)
    assert run.finish is Finish.COMPLETE
    assert "the light's monitor changed by +20.0% since the first pose (pose 1)" in run.warnings[0]
    fault_record.row(text(spoil), "warned, noted in the journal", run.light_after)


@fault(11)
def test_a_light_that_stays_cold_pauses_before_the_first_pose(tmp_path: Path, fault_record: FaultRecord) -> None:
    rig = bench.rig_config(warm_up_s=20.0, steady_per_minute=1e-3)
    cold = rig.simulation.model_copy(update={"warm_up_drift": 0.2, "warm_up_s": 600.0})
    run = bench.run(tmp_path / "s.h5", rig=rig.model_copy(update={"simulation": cold}))
    assert run.finish is Finish.PAUSED
    assert "after 40 s the light still drifts by -3." in run.message
    assert bench.n_complete(run.path) == 0
    fault_record.row("a lamp that takes ten minutes to warm up, rated at 20 s", "paused before the first pose", None)


@fault(15)
@pytest.mark.parametrize("device", ["camera", "light", "stage"])
def test_a_port_that_may_not_be_opened_leaves_no_half_open_rig(
    tmp_path: Path, fault_record: FaultRecord, device: str
) -> None:
    spoil = Fault(device, "denied", "connect")
    run = bench.run(tmp_path / "s.h5", spoil)
    assert run.finish is None
    assert "Add yourself to the group" in run.message
    assert list(tmp_path.iterdir()) == []
    assert run.lit_times == []
    fault_record.row(text(spoil), "refused with the mend; nothing is opened, moved or written", None)


@fault(26)
@pytest.mark.parametrize("device", ["camera", "light", "stage"])
def test_another_device_that_comes_back_in_place_of_the_first_is_refused(
    tmp_path: Path, whole: dict[str, object], fault_record: FaultRecord, device: str
) -> None:
    gone = Fault("camera", "lost", "trigger", 8)
    # The serial numbers are read when the rig is connected, when the run begins, and when it is connected again.
    swapped = Fault(device, "other_serial", "describe", after=0.3, repeats=ALWAYS)
    run = bench.run(tmp_path / "s.h5", gone, swapped)
    assert run.finish is Finish.FAULT
    assert f"the {device} is 'another {device}' and should be 'sim-3'" in run.message
    assert run.is_dark
    assert bench.resumed(run.path) == whole
    fault_record.row(
        f"{text(gone)}; another {device} is plugged in", "refused by its serial number; resumable", run.light_after
    )
