import json
from pathlib import Path

import numpy as np
import pytest

from drivers.errors import DeviceError
from instrument.files.validation import InvalidInputError
from instrument.recording.recorder import Recorder
from instrument.session.layout import Status
from instrument.session.session import Session
from protocols.capture.engine import CaptureFaultError, Finish, Outcome, Progress, State, capture, resume
from tests.campaigns.small_rig import content
from tests.protocols.fakes import FakeBench, Script, fault_at, no_fault, protocol_config, rig_config
from tests.verifying import verify_session


def run(path: Path, script: Script = no_fault) -> tuple[FakeBench, Outcome | None]:
    bench = FakeBench(script)
    try:
        return bench, capture(rig_config(), protocol_config(), path, devices=bench.devices)
    except DeviceError:
        return bench, None


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, object], list[str]]:
    path = tmp_path_factory.mktemp("whole") / "s.h5"
    bench, _ = run(path)
    return content(path), bench.calls


def test_a_capture_goes_through_darks_and_poses_in_order(whole: tuple[object, list[str]]) -> None:
    calls = [call for call in whole[1] if call != "camera.set_exposure_time"]
    # The last frame of a pose looks whether the light went out.
    pose = ["stage.move", "light.on", *["camera.trigger", "light.read"] * 2, "light.off", "camera.trigger"]
    safe = ["light.off", "stage.stop", "camera.stop"]
    connect = ["light.connect", "stage.connect", "camera.connect", "stage.home"]
    disconnect = ["camera.disconnect", "stage.disconnect", "light.disconnect"]
    darks = ["light.off", "camera.trigger", "camera.trigger"] * 2
    # safe() twice: once before the file is closed, once when the rig is left.
    assert calls == [*connect, *darks, *pose, *pose, *safe, *safe, *disconnect]


def test_a_capture_ends_complete_and_verified(tmp_path: Path) -> None:
    _, outcome = run(tmp_path / "s.h5")
    assert outcome is not None
    assert outcome == Outcome(Finish.COMPLETE, tmp_path / "s.h5", 2, 2, "complete", outcome.seconds)
    assert list(verify_session(tmp_path / "s.h5")) == []


@pytest.mark.parametrize(("error", "step"), [(KeyboardInterrupt, 3), (DeviceError, 5), (RuntimeError, 7)])
def test_after_an_error_at_some_call_the_light_is_off_and_resume_gives_the_same_data(
    tmp_path: Path, whole: tuple[dict[str, object], list[str]], error: type[BaseException], step: int
) -> None:
    expected, calls = whole
    for number in range(calls.index("stage.home"), calls.index("stage.stop"), step):
        path = tmp_path / f"{error.__name__}{number}.h5"
        bench = FakeBench(fault_at({number}, error))
        try:
            outcome = capture(rig_config(), protocol_config(), path, devices=bench.devices)
            assert outcome.finish is (Finish.PAUSED if error is KeyboardInterrupt else Finish.COMPLETE)
        except (RuntimeError, DeviceError):
            pass
        assert not bench.lit
        assert bench.calls[-3:] == ["camera.disconnect", "stage.disconnect", "light.disconnect"]
        assert list(verify_session(path)) == []
        resume(path, devices=FakeBench().devices)
        assert content(path) == expected, number


def test_a_device_that_fails_once_costs_one_more_attempt(
    tmp_path: Path, whole: tuple[dict[str, object], list[str]]
) -> None:
    number = whole[1].index("light.read")
    _, outcome = run(tmp_path / "s.h5", fault_at({number}, DeviceError))
    assert outcome is not None
    assert outcome.finish is Finish.COMPLETE
    assert content(tmp_path / "s.h5") == whole[0]
    with Session(tmp_path / "s.h5") as session:
        repeated = [event for event in map(json.loads, session.events) if event["event"] == "repeated"]
    assert [(event["what"], event["attempt"]) for event in repeated] == [("pose 0", 1)]
    assert "light.read failed" in repeated[0]["why"]


def test_a_device_that_keeps_failing_ends_in_a_fault_that_says_how_to_go_on(tmp_path: Path) -> None:
    def second_pose(_: int, name: str) -> None:
        if name == "camera.trigger" and bench.position["turn"] > 90:
            raise DeviceError("cable out")

    bench, path, seen = FakeBench(second_pose), tmp_path / "s.h5", list[Progress]()
    with pytest.raises(CaptureFaultError) as caught:
        capture(rig_config(), protocol_config(), path, seen.append, bench.devices)
    assert f"cable out. The light is off; 1 of 2 poses are safe in {path}." in str(caught.value)
    assert f"halfangle resume {path}" in str(caught.value)
    assert bench.calls.count("stage.move") == 1 + 3
    assert seen[-1].state is State.FAULT
    assert not bench.lit
    with Session(path) as session:
        assert session.status is Status.INTERRUPTED
        assert session.pose_complete.tolist() == [True, False]


def test_ctrl_c_pauses_and_says_how_to_resume(tmp_path: Path) -> None:
    bench, outcome = run(tmp_path / "s.h5", fault_at({30}, KeyboardInterrupt))
    assert outcome is not None
    assert outcome.finish is Finish.PAUSED
    assert f"Go on with: halfangle resume {tmp_path / 's.h5'}" in outcome.message
    assert not bench.lit


def test_a_light_that_does_not_obey_after_ctrl_c_is_a_loud_error_and_not_a_pause(tmp_path: Path) -> None:
    def stuck(number: int, name: str) -> None:
        if number == 30:
            raise KeyboardInterrupt
        if number > 30 and name == "light.off":
            raise DeviceError("no answer")

    bench = FakeBench(stuck)
    with pytest.raises(CaptureFaultError, match="NOT SAFE: light off failed: no answer"):
        capture(rig_config(), protocol_config(), tmp_path / "s.h5", devices=bench.devices)
    assert {"stage.stop", "camera.stop"} <= set(bench.calls[31:])
    with Session(tmp_path / "s.h5") as session:
        assert session.status is Status.INTERRUPTED


def test_the_light_goes_off_before_the_file_is_touched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full_disk(*_: object) -> None:
        assert bench.calls[-3:] == ["light.off", "stage.stop", "camera.stop"]
        raise OSError(28, "No space left on device")

    number, close = 25, Recorder.close
    bench = FakeBench(fault_at({number}, KeyboardInterrupt))
    with monkeypatch.context() as patch:
        patch.setattr(Recorder, "close", full_disk)
        patch.setattr(Recorder, "__exit__", lambda recorder, *_: close(recorder, Status.INTERRUPTED))
        outcome = capture(rig_config(), protocol_config(), tmp_path / "s.h5", devices=bench.devices)
    assert "The light is off" in outcome.message
    assert "The session could not be closed: [Errno 28] No space left on device." in outcome.message


def test_a_disk_that_fills_up_ends_dark_and_says_how_to_go_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full_disk(*_: object) -> None:
        raise OSError(28, "No space left on device")

    bench, path = FakeBench(), tmp_path / "s.h5"
    with monkeypatch.context() as patch:
        patch.setattr(Recorder, "write_pose", full_disk)
        with pytest.raises(OSError, match=r"No space left on device\. The light is off; 0 of 2 poses are safe"):
            capture(rig_config(), protocol_config(), path, devices=bench.devices)
    assert not bench.lit
    assert resume(path, devices=FakeBench().devices).finish is Finish.COMPLETE


def test_a_failing_progress_callback_stops_nothing(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    def broken(_: Progress) -> None:
        raise ZeroDivisionError

    outcome = capture(rig_config(), protocol_config(), tmp_path / "s.h5", broken, FakeBench().devices)
    assert outcome.finish is Finish.COMPLETE
    assert "the capture goes on" in caplog.text


def test_progress_counts_poses_and_frames_and_estimates_the_rest(tmp_path: Path) -> None:
    seen: list[Progress] = []
    capture(rig_config(), protocol_config(), tmp_path / "s.h5", seen.append, FakeBench().devices)
    assert [progress.state.name for progress in seen] == [
        "PREFLIGHT", "RUNNING", "RUNNING", "RUNNING", "RUNNING", "RUNNING", "RUNNING", "FINISHING", "SAFE",
    ]  # fmt: skip
    # Poses are written while the next one is taken; only what is on the disk counts.
    assert [progress.n_complete for progress in seen[:4]] == [0, 0, 0, 0]
    assert seen[-1].n_complete == 2
    assert [progress.n_frames for progress in seen] == [0, 0, 0, 4, 6, 6, 8, 8, 8]
    assert np.isnan(seen[3].remaining)
    assert seen[4].remaining > 0
    assert seen[-1].remaining == 0


def test_resuming_a_complete_session_touches_no_device(tmp_path: Path) -> None:
    path = tmp_path / "s.h5"
    run(path)
    before, bench = path.read_bytes(), FakeBench()
    outcome = resume(path, devices=bench.devices)
    assert outcome.message == "already complete; there is nothing to do"
    assert bench.calls == []
    assert path.read_bytes() == before


def test_resuming_with_other_devices_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.h5"
    run(path, fault_at({30}, KeyboardInterrupt))
    other = FakeBench(serial_number="two")
    with pytest.raises(DeviceError, match="the camera is 'two' and should be 'one'"):
        resume(path, devices=other.devices)
    assert "stage.home" not in other.calls


def test_a_second_writer_in_this_program_is_refused_and_a_reader_is_not(tmp_path: Path) -> None:
    path = tmp_path / "s.h5"
    run(path, fault_at({30}, KeyboardInterrupt))
    bench, refused, seen = FakeBench(), list[str](), list[Status]()

    def meddle(_: Progress) -> None:
        if "stage.home" in bench.calls and not refused:
            with pytest.raises(OSError, match="cannot be written") as caught:
                resume(path, devices=FakeBench().devices)
            refused.append(str(caught.value))
            with Session(path) as session:
                seen.append(session.status)

    assert resume(path, meddle, bench.devices).finish is Finish.COMPLETE
    assert "open in this program already" in refused[0]
    assert seen == [Status.RECORDING]
    assert list(verify_session(path)) == []


def test_a_plan_beyond_the_limits_is_refused_before_anything_moves(tmp_path: Path) -> None:
    protocol = protocol_config(times=(1e-5, 0.1, 20.0))
    steep = protocol.model_copy(update={"rings": (protocol.rings[0].model_copy(update={"tilt_deg": 70.0}),)})
    bench = FakeBench()
    with pytest.raises(InvalidInputError) as caught:
        capture(rig_config(), steep, tmp_path / "s.h5", devices=bench.devices)
    text = str(caught.value)
    assert "pose 1, axis 'tilt': the value is 70 deg; allowed is -60 to 60 deg" in text
    assert "the value is 1e-05 s; allowed is 0.0001 to 10 s" in text
    assert "the value is 20 s" in text
    assert list(tmp_path.iterdir()) == []
    assert "stage.home" not in bench.calls


def test_an_existing_file_is_never_overwritten(tmp_path: Path) -> None:
    path, bench = tmp_path / "s.h5", FakeBench()
    path.write_text("precious")
    with pytest.raises(FileExistsError, match="exists and is not overwritten"):
        capture(rig_config(), protocol_config(), path, devices=bench.devices)
    assert path.read_text() == "precious"
    assert bench.calls == []
