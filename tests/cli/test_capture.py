import json
import re
import signal
from pathlib import Path
from typing import Any

import pytest
from click.testing import CliRunner
from rich.console import Console

from cli.main import halfangle, main
from cli.progress import progress_bar
from instrument.session.records import PoseRecord
from instrument.session.session import Session
from protocols.acquisition.bracket import take_pose
from protocols.capture import run
from protocols.planning.plan import Plan

RIG = """
name = "small bench"
camera = { driver = "simulated", width = 32, height = 24, focal_length_px = 60.0 }
light = { driver = "simulated", offset_mm = [12.0, 0.0, 0.0], offset_sigma_mm = 3.0 }
stage = { driver = "simulated" }
geometry = { working_distance_mm = 350.0, area_mm = [60.0, 60.0] }
simulation = { warm_up_drift = 0.0 }
"""
PROTOCOL = """
name = "three views"
bracket = { exposure_times_s = [0.002, 0.02], darks = 2 }
rings = [{ tilt_deg = 20.0, count = 3 }]
"""


@pytest.fixture
def files(tmp_path: Path) -> list[str]:
    (tmp_path / "rig.toml").write_text(RIG)
    (tmp_path / "protocol.toml").write_text(PROTOCOL)
    return [str(tmp_path / "protocol.toml"), "--rig", str(tmp_path / "rig.toml")]


def exit_code(arguments: list[str]) -> int:
    with pytest.raises(SystemExit) as caught:
        main(arguments)
    return int(caught.value.code or 0)


def test_plan_prints_what_the_capture_would_take(
    files: list[str], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    assert exit_code(["plan", *files]) == 0
    text = capsys.readouterr().out
    assert "three views on small bench" in text
    assert "poses     3" in text
    assert exit_code(["plan", *files, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["n_frames"], data["n_darks"]) == (6, 4)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["protocol.toml", "rig.toml"]


def test_capture_writes_a_session_and_refuses_to_write_it_again(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = str(tmp_path / "s.h5")
    assert exit_code(["capture", *files, "-o", path]) == 0
    output = capsys.readouterr()
    assert re.fullmatch(rf"{re.escape(path)}: 3 of 3 poses, complete in [\d.]+ s\n", output.out)
    assert output.err == ""
    assert exit_code(["capture", *files, "-o", path]) == 1
    assert "exists and is not overwritten" in capsys.readouterr().err


def test_ctrl_c_ends_a_capture_after_its_pose_and_resume_completes_it(
    files: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def take_and_interrupt(*arguments: Any) -> PoseRecord:
        if len(taken) == 1:
            signal.raise_signal(signal.SIGINT)
        taken.append(take_pose(*arguments))
        return taken[-1]

    taken: list[PoseRecord] = []
    path = str(tmp_path / "s.h5")
    with monkeypatch.context() as patch:
        patch.setattr(run, "take_pose", take_and_interrupt)
        assert exit_code(["capture", *files, "-o", path]) == 1
    assert f"2 of 3 poses are safe in {path}. Go on with: halfangle resume {path}" in capsys.readouterr().out
    assert exit_code(["resume", path]) == 0
    assert capsys.readouterr().out.startswith(f"{path}: 3 of 3 poses, complete")
    assert exit_code(["resume", path]) == 0
    assert "already complete; there is nothing to do" in capsys.readouterr().out
    assert exit_code(["session", "verify", path]) == 0


def test_a_bad_configuration_exits_2_with_all_problems_and_writes_nothing(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "rig.toml").write_text(RIG.replace("width", "widht").replace("60.0, 60.0", "60.0, -1"))
    assert exit_code(["capture", *files, "-o", str(tmp_path / "s.h5")]) == 2
    text = capsys.readouterr().err
    assert "rig.toml:3: unknown key 'widht'" in text
    assert "rig.toml:6: geometry.area_mm[1] is -1" in text
    assert sorted(path.name for path in tmp_path.iterdir()) == ["protocol.toml", "rig.toml"]


def test_a_plan_that_the_rig_cannot_do_exits_2_and_writes_nothing(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "protocol.toml").write_text(PROTOCOL.replace("20.0", "80.0"))
    assert exit_code(["capture", *files, "-o", str(tmp_path / "s.h5")]) == 2
    assert "the value is 80 deg; allowed is -65 to 65 deg" in capsys.readouterr().err
    assert not (tmp_path / "s.h5").exists()


def test_a_full_disk_is_found_before_the_capture(
    files: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(Plan, "bytes", lambda *_: 10**18)
    assert exit_code(["capture", *files, "-o", str(tmp_path / "s.h5")]) == 2
    assert re.search(r"disk full; it needs up to [\d.]+ GB, and [\d.]+ [MG]B are free", capsys.readouterr().err)
    assert not (tmp_path / "s.h5").exists()


def test_the_rig_and_protocol_files_are_kept_in_the_session(files: list[str], tmp_path: Path) -> None:
    assert exit_code(["capture", *files, "-o", str(tmp_path / "s.h5")]) == 0
    with Session(tmp_path / "s.h5") as session:
        assert session.rig_text == RIG
        assert session.protocol_text == PROTOCOL


@pytest.mark.parametrize("command", ["plan", "capture", "resume"])
def test_the_help_of_each_command_shows_an_example(command: str) -> None:
    result = CliRunner().invoke(halfangle, [command, "--help"])
    assert result.exit_code == 0
    assert f"Example: halfangle {command} " in result.output


def test_the_progress_bar_is_silent_where_there_is_no_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with progress_bar("capture", total=2) as step:
        step(1, "pose 1 of 2")
    assert capsys.readouterr() == ("", "")


def test_the_progress_bar_shows_the_step_on_a_terminal() -> None:
    console = Console(force_terminal=True, record=True, width=120)
    with progress_bar("capture", console=console) as step:
        step(1, "pose 2 of 2", 2)
    assert re.search(r"capture .*1/2 .*pose 2 of 2", console.export_text())


def test_a_rig_that_is_not_known_to_be_dark_has_an_exit_code_of_its_own(
    files: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """It is no ordinary failure: somebody has to look at the rig."""
    (tmp_path / "faults.toml").write_text(
        '[[faults]]\ndevice = "light"\ncall = "off"\nat = 4\neffect = "stays_on"\nrepeats = 1000\n'
    )
    with pytest.raises(SystemExit) as ended:
        main(["capture", *files, "-o", str(tmp_path / "s.h5"), "--faults", str(tmp_path / "faults.toml")])
    assert ended.value.code == 4
    assert "NOT SAFE: light off failed" in capsys.readouterr().err
