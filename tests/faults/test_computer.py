"""What becomes of a capture when the computer or its user goes wrong, fault by fault."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from drivers.errors import UnsafeError
from drivers.registry import Devices
from drivers.simulated.geometry import translation
from instrument.files.validation import InvalidInputError
from instrument.recording import recorder
from instrument.recording.recorder import _BOOKKEEPING, Recorder
from instrument.rig.lock import RigBusyError
from instrument.rig.rig import Rig
from instrument.session import audit, layout
from instrument.session.records import PoseRecord
from instrument.session.session import Session
from protocols.capture import pose_writer
from protocols.capture.engine import CaptureFaultError, Control, Finish, Progress, State, capture, resume
from tests.campaigns.small_rig import ended, processes
from tests.faults import bench
from tests.faults.bench import FaultyBench
from tests.faults.record import FaultRecord
from tests.verifying import verify_session

ROOT = Path(__file__).parents[2]

fault = pytest.mark.fault

_HANG_S = 600.0  # a wait that ends so has hung


def capture_with(path: Path, devices: FaultyBench, **options: Any) -> Finish:
    return capture(bench.rig_config(), bench.protocol_config(), path, devices=devices.devices, **options).finish


@fault(16)
def test_a_kill_at_some_write_of_a_pose_leaves_what_was_complete(
    tmp_path: Path, whole: dict[str, object], fault_record: FaultRecord
) -> None:
    for number in range(1, 60, 11):
        path = tmp_path / f"{number}.h5"
        process = processes().Process(target=bench.capture_and_die, args=(str(path), number))
        process.start()
        assert ended(process) == -signal.SIGKILL
        assert list(verify_session(path)) == []
        assert bench.only_whole_poses(path)
        assert bench.resumed(path) == whole
    fault_record.row(
        "SIGKILL before one of the writes to the file (and 200 at random times in `make soak`)",
        "the file opens, complete poses are intact, resumed to the same frames",
        None,
    )


@fault(17)
def test_a_copy_taken_at_any_flush_or_with_its_tail_cut_is_resumed_or_refused(
    tmp_path: Path, whole: dict[str, object], fault_record: FaultRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    copies: list[Path] = []
    sync = recorder.sync

    def sync_and_copy(file: Any) -> None:
        sync(file)
        copies.append(tmp_path / f"copy{len(copies)}.h5")
        shutil.copy(file.filename, copies[-1])

    with monkeypatch.context() as patch:
        patch.setattr(recorder, "sync", sync_and_copy)
        assert capture_with(tmp_path / "s.h5", FaultyBench()) is Finish.COMPLETE
    assert len(copies) >= 6
    for copy in copies:
        assert list(verify_session(copy)) == []
        assert bench.resumed(copy) == whole
    size = (tmp_path / "s.h5").stat().st_size
    for share in (0.999, 0.98, 0.9, 0.5, 0.1):
        cut = tmp_path / "cut.h5"
        cut.write_bytes((tmp_path / "s.h5").read_bytes()[: int(share * size)])
        before = cut.read_bytes()
        with pytest.raises(InvalidInputError, match=r"cut short|damaged"):
            resume(cut, devices=FaultyBench().devices)
        assert cut.read_bytes() == before
    fault_record.row("a copy at each flush; the last 0.1 to 90 % cut off", "resumed to the same frames; refused", None)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A disk of its own with 2 MB, where root may mount one."""
    folder = tmp_path / "disk"
    folder.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=2m", "tmpfs", str(folder)]
    if os.geteuid() != 0 or subprocess.run(mount, check=False, capture_output=True).returncode:
        pytest.skip("mounting a small disk needs root; the quota of the next test needs none")
    yield folder
    subprocess.run(["umount", str(folder)], check=True)


@fault(18)
def test_a_disk_that_is_too_small_is_refused_before_anything_moves(
    tmp_path: Path, fault_record: FaultRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    usage = shutil.disk_usage(tmp_path)._replace(free=100_000)
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage)
    devices = FaultyBench()
    with pytest.raises(InvalidInputError, match=r"disk full; it needs up to \d+ kB, and 100 kB are free"):
        capture_with(tmp_path / "s.h5", devices)
    assert devices.world is not None
    assert devices.world.lamp.history == []
    assert list(tmp_path.iterdir()) == []
    fault_record.row("0.1 MB free", "refused by the preflight, nothing moved, lit or written", None)


def captured_on_full_disk(path: Path, tmp_path: Path, n_bytes: int, others: Path | None = None) -> str:
    """Capture in a process of its own, which HDF5 may take down after a disk is full; return what it said before."""
    said = tmp_path / "said"
    process = processes().Process(target=bench.capture_on_full_disk, args=(str(path), str(said), n_bytes, others))
    process.start()
    assert ended(process) is not None
    return said.read_text()


@fault(18)
def test_a_disk_that_fills_up_ends_dark_with_a_file_that_reads(
    tmp_path: Path, whole: dict[str, object], fault_record: FaultRecord
) -> None:
    size = bench.run(tmp_path / "all.h5").path.stat().st_size
    left = set()
    # Room for bookkeeping is made sure of before each write; between no pose and all, it ends at any.
    for missing in range(0, 50_000, 12_000):
        path = tmp_path / f"{missing}.h5"
        said = captured_on_full_disk(path, tmp_path, size + _BOOKKEEPING - missing)
        left.add(bench.n_complete(path))
        assert "The light is off" in said
        assert "lit: False" in said
        assert list(verify_session(path)) == []
        assert bench.only_whole_poses(path)
        assert bench.resumed(path) == whole
    assert len(left) > 1
    how = "room is made sure of before each write; dark, the file verifies; resumed to the same frames"
    fault_record.row("quotas that end within any pose", how, None)


@fault(18)
def test_a_small_disk_that_others_fill_ends_dark_with_a_file_that_reads(
    small_disk: Path, tmp_path: Path, whole: dict[str, object], fault_record: FaultRecord
) -> None:
    path = small_disk / "s.h5"
    said = captured_on_full_disk(path, tmp_path, 0, small_disk / "others")
    assert "The light is off" in said
    assert "lit: False" in said
    (small_disk / "others").unlink()
    copy = Path(shutil.copy(path, tmp_path / "copy.h5"))
    assert bench.n_complete(copy) == 1
    assert bench.resumed(copy) == whole
    fault_record.row("a small disk that somebody else fills", "dark, readable, resumed to the same frames", None)


@fault(19)
def test_a_slow_disk_makes_the_rig_wait_in_the_dark_with_bounded_memory(
    tmp_path: Path, whole: dict[str, object], fault_record: FaultRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_pose, devices = Recorder.write_pose, FaultyBench()
    waiting: list[bool] = []
    waited = threading.Event()

    def slowly(self: Recorder, i_pose: int, record: PoseRecord, events: Sequence[str]) -> None:
        # Slower than the poses come, however fast this computer is.
        waited.wait(_HANG_S)
        write_pose(self, i_pose, record, events)

    def watch(progress: Progress) -> None:
        if progress.message.startswith("waiting for the disk"):
            assert devices.world is not None
            waiting.append(devices.world.lamp.level > 0.0)
            waited.set()

    monkeypatch.setattr(pose_writer, "DEPTH", 1)
    with monkeypatch.context() as patch:
        patch.setattr(Recorder, "write_pose", slowly)
        assert capture_with(tmp_path / "s.h5", devices, progress=watch) is Finish.COMPLETE
    assert waiting
    assert not any(waiting)
    assert bench.content(tmp_path / "s.h5") == whole
    fault_record.row("slower than the poses come", "waits between poses, at most two of them in memory; complete", None)


@fault(19)
def test_a_disk_that_stalls_is_a_fault_and_not_a_wait_for_ever(
    tmp_path: Path, whole: dict[str, object], fault_record: FaultRecord, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_pose, devices, stalled = Recorder.write_pose, FaultyBench(), threading.Event()
    before = set(threading.enumerate())

    def stall(self: Recorder, i_pose: int, record: PoseRecord, events: Sequence[str]) -> None:
        stalled.wait(_HANG_S)
        write_pose(self, i_pose, record, events)

    with monkeypatch.context() as patch:
        patch.setattr(pose_writer, "DISK_LIMIT", 0.2)
        patch.setattr(Recorder, "write_pose", stall)
        with pytest.raises(OSError, match=r"the disk has taken no pose for 0.2 s.*The light is off"):
            capture_with(tmp_path / "s.h5", devices)
        stalled.set()
    assert devices.world is not None
    assert devices.world.lamp.level == 0.0
    for thread in threading.enumerate():
        if thread not in before:
            thread.join(_HANG_S)
    assert bench.resumed(tmp_path / "s.h5") == whole
    fault_record.row("a disk that takes nothing (limit set to 0.2 s)", "a fault with the light off; resumable", None)


INTERRUPTED = """
import signal, sys, time
from pathlib import Path
from instrument.rig.rig import Rig
from protocols.capture.engine import capture
from tests.faults import bench

n_signals, when = int(sys.argv[2]), sys.argv[3]
rig = bench.rig_config()
safe = Rig.safe

def interrupt(number):
    for _ in range(number):
        signal.raise_signal(signal.SIGINT)

def interrupted_safe(self):
    if when == "clean-up":
        interrupt(3)
    return safe(self)

def watch(progress):
    if progress.message.startswith("pose 2"):
        interrupt(n_signals)

Rig.safe = interrupted_safe
outcome = capture(rig, bench.protocol_config(), sys.argv[1], watch)
print(outcome.finish.value, outcome.n_complete, flush=True)
"""


@fault(20)
@pytest.mark.parametrize(
    ("n_signals", "when", "expected", "what"),
    [
        (1, "pose", "paused 2", "once: the pose is finished, then paused"),
        (2, "pose", "aborted 1", "twice: the pose is given up at once, aborted"),
        (1, "clean-up", "paused 2", "once, and three times more during each clean-up: no effect on it"),
    ],
)
def test_ctrl_c_pauses_twice_aborts_and_never_interrupts_the_clean_up(
    tmp_path: Path,
    whole: dict[str, object],
    fault_record: FaultRecord,
    n_signals: int,
    when: str,
    expected: str,
    what: str,
) -> None:
    path = tmp_path / "s.h5"
    arguments = [sys.executable, "-c", INTERRUPTED, str(path), str(n_signals), when]
    done = subprocess.run(arguments, check=False, capture_output=True, text=True, cwd=ROOT, timeout=100)
    assert done.stdout.strip() == expected, done.stderr
    assert list(verify_session(path)) == []
    assert bench.resumed(path) == whole
    fault_record.row(
        f"SIGINT {what.split(':', maxsplit=1)[0]}", f"{what.split(': ')[1]}; resumed to the same frames", None
    )


@fault(20)
def test_an_abort_from_another_thread_ends_a_motion_at_once(tmp_path: Path, whole: dict[str, object]) -> None:
    rig = bench.rig_config()
    slow = rig.model_copy(update={"simulation": rig.simulation.model_copy(update={"real_time": True})})
    control = Control()
    moving = threading.Event()

    def watch(progress: Progress) -> None:
        if progress.state is State.RUNNING:
            moving.set()

    def abort() -> None:
        moving.wait(_HANG_S)
        control.abort()

    threading.Thread(target=abort).start()
    outcome = capture(slow, bench.protocol_config(), tmp_path / "s.h5", watch, control=control)
    assert outcome.finish is Finish.ABORTED
    assert outcome.n_complete < outcome.n_poses
    assert bench.resumed(tmp_path / "s.h5") == whole


@fault(21)
def test_an_exception_in_a_callback_is_logged_and_stops_nothing(
    tmp_path: Path, whole: dict[str, object], fault_record: FaultRecord, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(_: Progress) -> None:
        raise ZeroDivisionError

    assert capture_with(tmp_path / "s.h5", FaultyBench(), progress=broken) is Finish.COMPLETE
    assert "the capture goes on" in caplog.text
    assert bench.content(tmp_path / "s.h5") == whole
    fault_record.row("a progress callback that raises at every report", "logged; complete", None)


@fault(22)
@pytest.mark.parametrize("jump", [timedelta(days=-400), timedelta(hours=1)])
def test_a_wall_clock_that_jumps_changes_labels_only(
    tmp_path: Path,
    whole: dict[str, object],
    fault_record: FaultRecord,
    monkeypatch: pytest.MonkeyPatch,
    jump: timedelta,
) -> None:
    class JumpingClock(datetime):
        n_asked = 0

        @classmethod
        def now(cls, tz: Any = None) -> datetime:
            cls.n_asked += 1
            return datetime.now(UTC) + jump * (cls.n_asked % 3)

    monkeypatch.setattr(audit, "datetime", JumpingClock)
    assert capture_with(tmp_path / "s.h5", FaultyBench()) is Finish.COMPLETE
    assert bench.content(tmp_path / "s.h5") == whole
    with Session(tmp_path / "s.h5") as session:
        assert (np.diff(session.timestamps.ravel()) > 0).all()
        assert 0.0 <= session.timestamps.min() < session.timestamps.max() < 60.0
    fault_record.row(f"{jump.total_seconds() / 3600:+.0f} h again and again", "times of frames go on; complete", None)


@fault(23)
def test_a_second_process_is_told_who_has_the_rig(tmp_path: Path, fault_record: FaultRecord) -> None:
    refused: list[str] = []

    def second(progress: Progress) -> None:
        if progress.message.startswith("pose") and not refused:
            with pytest.raises(RigBusyError) as caught:
                capture_with(tmp_path / "other.h5", FaultyBench())
            refused.append(str(caught.value))

    assert capture_with(tmp_path / "s.h5", FaultyBench(), progress=second) is Finish.COMPLETE
    assert f"the rig 'small bench' is in use by process {os.getpid()} on " in refused[0]
    assert not (tmp_path / "other.h5").exists()
    fault_record.row("a second capture on the rig", "refused: names process, host, user, since when", None)


@fault(23)
def test_a_lock_of_a_process_that_died_is_none(tmp_path: Path, fault_record: FaultRecord) -> None:
    process = processes().Process(target=bench.hold_rig, args=(str(tmp_path / "held"),))
    process.start()
    while not (tmp_path / "held").exists():
        time.sleep(0.01)
    with pytest.raises(RigBusyError, match=f"process {process.pid} on"):
        capture_with(tmp_path / "s.h5", FaultyBench())
    process.kill()
    process.join()
    assert capture_with(tmp_path / "s.h5", FaultyBench()) is Finish.COMPLETE
    fault_record.row("kill -9 of the process that holds the rig", "the lock dies with it", None)


@fault(23)
def test_a_second_writer_of_one_file_is_refused(tmp_path: Path, fault_record: FaultRecord) -> None:
    path, refused = tmp_path / "s.h5", list[str]()
    assert bench.run(path, watcher=_interrupt_at_second).finish is Finish.PAUSED
    with Recorder(path), pytest.raises(OSError, match="cannot be written") as caught:
        resume(path, devices=FaultyBench().devices)
    refused.append(str(caught.value))
    assert bench.n_complete(path) == 1
    fault_record.row("a second process that writes the session", "refused; readers are not", None)


def _interrupt_at_second(progress: Progress) -> None:
    if progress.message.startswith("pose 2"):
        raise KeyboardInterrupt


@fault(24)
@pytest.mark.parametrize(
    ("name", "text", "where"),
    [
        ("rig.toml", "[camera", "rig.toml:1"),
        ("rig.toml", 'name = "b"\n[stage]\ndriver = "grbll"\n', "rig.toml:3: stage.driver"),
        ("protocol.toml", "[bracket]\nexposure_times_s = [0.1, 0.01]\n", "protocol.toml:2: bracket.exposure_times_s"),
        ("protocol.py", "name = 3\ndef poses():\n    yield 1 / 0\n", "protocol.py"),
        ("faults.toml", '[[faults]]\ndevice = "stage"\neffect = "torn_frame"\n', "a stage knows"),
    ],
)
def test_a_malformed_file_is_named_by_line_and_moves_nothing(
    tmp_path: Path, fault_record: FaultRecord, name: str, text: str, where: str
) -> None:
    (tmp_path / name).write_text(text)
    files = {kind: str(ROOT / "examples" / f"{kind}.toml") for kind in ("simulated", "quick_sweep", "faults")}
    protocol = str(tmp_path / name) if name.startswith("protocol") else files["quick_sweep"]
    rig = str(tmp_path / name) if name.startswith("rig") else files["simulated"]
    faults = str(tmp_path / name) if name.startswith("faults") else files["faults"]
    command = [sys.executable, "-m", "cli.main", "capture", protocol, "--rig", rig, "--faults", faults]
    call = "import sys; from cli.main import main; main(sys.argv[1:])"
    arguments = [sys.executable, "-c", call, *command[3:], "-o", str(tmp_path / "s.h5")]
    done = subprocess.run(arguments, check=False, capture_output=True, text=True, cwd=ROOT, timeout=60)
    assert done.returncode == 2
    assert where in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "s.h5").exists()
    fault_record.row(f"a malformed `{name}`", "exit code 2 with file, line, key and why", None)


@fault(25)
def test_a_session_that_is_no_more_is_refused_and_not_changed(tmp_path: Path, fault_record: FaultRecord) -> None:
    path = bench.run(tmp_path / "s.h5", watcher=_interrupt_at_second).path
    with h5py.File(path) as file:
        frame = file[layout.IMAGES.path].id.get_chunk_info(0).byte_offset
    content = bytearray(path.read_bytes())
    content[frame : frame + 2000] = bytes(2000)
    path.write_bytes(content)
    (tmp_path / "foreign.h5").write_bytes(b"something else")
    for broken in (path, tmp_path / "foreign.h5"):
        before = broken.read_bytes()
        problems = _problems(broken)
        assert any("pose 0, exposure 0" in problem or "not an HDF5 file" in problem for problem in problems)
        assert broken.read_bytes() == before
    fault_record.row("2000 zeroed bytes; a file of another kind", "`session verify` says what is good; unchanged", None)


def _problems(path: Path) -> list[str]:
    try:
        return [str(problem) for problem in verify_session(path)]
    except InvalidInputError as error:
        return [str(problem) for problem in error.problems]


@fault(26)
def test_a_sample_that_was_moved_before_a_resume_is_refused_unless_accepted(
    tmp_path: Path, fault_record: FaultRecord
) -> None:
    path = bench.run(tmp_path / "s.h5", watcher=_interrupt_at_second).path
    moved = FaultyBench()

    def devices(rig: Any) -> Devices:
        opened = moved.devices(rig)
        assert moved.world is not None
        moved.world._mount = moved.world._mount @ translation(np.array([12.0, 5.0, 0.0]))
        return opened

    with pytest.raises(CaptureFaultError, match=r"pose 0 looks different now: \d+% of the picture"):
        resume(path, devices=devices)
    assert bench.n_complete(path) == 1
    assert resume(path, devices=devices, accept_moved=True).finish is Finish.COMPLETE
    fault_record.row("the sample shifted by 13 mm before a resume", "refused; `--accept-moved` goes on", None)


@fault(26)
def test_a_device_of_another_serial_number_than_the_rig_file_names_is_refused(
    tmp_path: Path, fault_record: FaultRecord
) -> None:
    rig = bench.rig_config()
    other = rig.model_copy(update={"camera": rig.camera.model_copy(update={"serial_number": "12345"})})
    with pytest.raises(UnsafeError, match=r"the camera is 'sim-3' and should be '12345'"), Rig.connected(other):
        pytest.fail("connected")
    fault_record.row("a camera of another serial number than `rig.toml` names", "refused before anything moves", None)
