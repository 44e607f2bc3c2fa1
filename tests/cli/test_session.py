import json
import shutil
from pathlib import Path

import h5py
import pytest
from click.testing import CliRunner

from cli.main import halfangle, main
from instrument import layout
from protocols.engine import capture
from tests.instrument.pictures.folders import mosaic, write_dng
from tests.protocols.fakes import FakeBench, protocol_config, rig_config


@pytest.fixture(scope="module")
def session_path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("session") / "coin.h5"
    capture(rig_config(), protocol_config(), path, devices=FakeBench().devices)
    return path


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as caught:
        main([str(argument) for argument in ("session", *arguments)])
    return int(caught.value.code or 0)


def test_info_says_what_a_session_holds(session_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("info", session_path) == 0
    text = capsys.readouterr().out
    assert "two views" in text
    assert "0.01, 0.1" in text
    assert run("info", session_path, "--json") == 0
    data = json.loads(capsys.readouterr().out)
    assert (data["status"], data["n_complete"], data["n_poses"]) == ("complete", 2, 2)
    assert data["frame_size"] == [24, 16]
    assert data["has_darks"] is True


def test_verify_exits_0_on_a_sound_session(session_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("verify", session_path) == 0
    assert capsys.readouterr().out == f"{session_path}: every check passed\n"
    assert run("verify", session_path, "--json") == 0
    assert json.loads(capsys.readouterr().out) == []


def test_verify_exits_1_and_names_the_frame_that_was_changed(
    session_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(session_path, tmp_path / "s.h5")
    with h5py.File(tmp_path / "s.h5", "r+") as file:
        file[layout.IMAGES.path][1, 0, 3, 3] ^= 1
    assert run("verify", tmp_path / "s.h5") == 1
    assert "pose 1, exposure 0 (0.01 s) differs from what was recorded" in capsys.readouterr().out
    assert run("verify", tmp_path / "s.h5", "--json") == 1
    (problem,) = json.loads(capsys.readouterr().out)
    assert problem["where"] == "/entry/instrument/camera/images"


@pytest.mark.parametrize("command", ["verify", "info"])
def test_what_is_no_session_exits_2(tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str) -> None:
    (tmp_path / "s.h5").write_text("hello")
    assert run(command, tmp_path / "s.h5") == 2
    assert "this is not an HDF5 file" in capsys.readouterr().err
    assert run(command, tmp_path / "none.h5") == 2
    assert "there is no such file" in capsys.readouterr().err


def test_list_shows_the_sessions_of_a_folder_and_nothing_else(
    session_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (session_path.parent / "other.h5").write_text("hello")
    assert run("list", session_path.parent) == 0
    assert capsys.readouterr().out.split() == ["complete", "2/2", str(session_path), "two", "views"]
    assert run("list", session_path.parent, "--json") == 0
    assert [row["title"] for row in json.loads(capsys.readouterr().out)] == ["two views"]


def test_export_writes_a_folder_that_import_reads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    # LibRaw reads no frames of less than 22 pixels, which those of the fakes are.
    write_dng(tmp_path / "a.dng", mosaic(0), 0.125)
    (tmp_path / "capture.toml").write_text('name = "leaf"\n')
    with pytest.raises(SystemExit):
        main(["import", str(tmp_path), "-o", str(tmp_path / "s.h5")])
    assert run("export", tmp_path / "s.h5", "-o", tmp_path / "out") == 0
    assert capsys.readouterr().out.endswith("out: 1 pictures and capture.toml\n")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["capture.toml", "pose_0000_0.dng"]
    assert run("export", tmp_path / "s.h5", "-o", tmp_path / "out") == 2
    assert "exists and is not overwritten" in capsys.readouterr().err


@pytest.mark.parametrize("command", ["info", "verify", "list", "export"])
def test_the_help_of_each_command_shows_an_example(command: str) -> None:
    result = CliRunner().invoke(halfangle, ["session", command, "--help"])
    assert result.exit_code == 0
    assert f"Example: halfangle session {command} " in result.output
