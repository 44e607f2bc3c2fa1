import json
import shutil
from pathlib import Path

import h5py
import pytest
from click.testing import CliRunner

from cli.main import halfangle, main
from instrument.session import layout
from protocols.capture.engine import capture
from tests.instrument.imports.folders import mosaic, write_dng
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
    assert capsys.readouterr().out == f"{session_path}: every check passed; 2 of 2 poses are good: 0-1\n"
    assert run("verify", session_path, "--json") == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["problems"], found["good_poses"], found["n_poses"]) == ([], [0, 1], 2)


def test_verify_exits_1_and_names_the_frame_that_was_changed(
    session_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(session_path, tmp_path / "s.h5")
    with h5py.File(tmp_path / "s.h5", "r+") as file:
        file[layout.IMAGES.path][1, 0, 3, 3] ^= 1
    assert run("verify", tmp_path / "s.h5") == 1
    text = capsys.readouterr().out
    assert "pose 1, exposure 0 (0.01 s) differs from what was recorded" in text
    assert "1 of 2 poses are good: 0\n" in text
    assert run("verify", tmp_path / "s.h5", "--json") == 1
    found = json.loads(capsys.readouterr().out)
    (problem,) = found["problems"]
    assert found["good_poses"] == [0]
    assert problem["where"] == "/entry/instrument/camera/images"


@pytest.mark.parametrize("command", ["verify", "info"])
def test_what_is_no_session_exits_2(tmp_path: Path, capsys: pytest.CaptureFixture[str], command: str) -> None:
    (tmp_path / "s.h5").write_text("hello")
    assert run(command, tmp_path / "s.h5") == 2
    assert "this is not an HDF5 file" in capsys.readouterr().err
    assert run(command, tmp_path / "none.h5") == 2
    assert "there is no such file" in capsys.readouterr().err


def interrupted(path: Path, status: str) -> Path:
    """Copy a session without its last pose, as one that says that it is `status`."""

    def last_pose_is_lost(file: h5py.File) -> None:
        file[layout.POSE_COMPLETE.path][-1] = 0
        file[layout.STATUS.path][()] = status

    copy = path.with_name(f"{status}.h5")
    shutil.copy(path, copy)
    with h5py.File(copy, "r+") as file:
        last_pose_is_lost(file)
    return copy


@pytest.fixture
def folder(session_path: Path, tmp_path: Path) -> Path:
    """A folder with a session of every state."""
    shutil.copy(session_path, tmp_path / "complete.h5")
    interrupted(tmp_path / "complete.h5", "interrupted")
    interrupted(tmp_path / "complete.h5", "recording")
    (tmp_path / "damaged.h5").write_bytes(session_path.read_bytes()[:-100])
    (tmp_path / "notes.h5").write_text("hello")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file.create_group("entry/stack")
        file["entry"].attrs["halfangle_schema"] = "1.0"
    return tmp_path


def test_list_leaves_nothing_out(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("list", folder) == 0
    lines = {Path(line.split(".h5")[0]).name.split()[-1]: line for line in capsys.readouterr().out.splitlines()}
    assert list(lines) == ["complete", "damaged", "interrupted", "notes", "other", "recording"]
    assert lines["complete"].split() == ["complete", "2/2", str(folder / "complete.h5"), "two", "views"]
    assert lines["damaged"].startswith("damaged ")
    assert "cut short" in lines["damaged"]
    assert lines["interrupted"].split()[:2] == ["interrupted", "1/2"]
    # Nobody writes it, so it was killed.
    assert lines["recording"].split()[:2] == ["interrupted", "1/2"]
    assert lines["notes"].startswith("damaged ")
    assert lines["other"].endswith("this is not a session: /entry holds stack")
    assert run("list", folder, "--json") == 0
    states = [row["state"] for row in json.loads(capsys.readouterr().out)]
    assert states == ["complete", "damaged", "interrupted", "damaged", "other", "interrupted"]


def test_a_session_that_another_process_writes_is_recording(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with h5py.File(folder / "recording.h5", "r+"):
        assert run("list", folder, "--json") == 0
        assert run("pack", folder / "recording.h5", "-o", folder / "packed.h5") == 2
    out, err = capsys.readouterr()
    assert json.loads(out)[-1]["state"] == "recording"
    assert "another process is writing it" in err


def test_a_title_cannot_steer_the_terminal(
    session_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shutil.copy(session_path, tmp_path / "s.h5")
    with h5py.File(tmp_path / "s.h5", "r+") as file:
        file[layout.TITLE.path][()] = "calm\x1b]0;pwned\x07\r\u202eevil"
        file["entry"]["\x1b[2J"] = h5py.ExternalLink("elsewhere.h5", "/")
    for command in (("list", tmp_path), ("verify", tmp_path / "s.h5"), ("info", tmp_path / "s.h5")):
        run(*command)
        out, err = capsys.readouterr()
        assert "\\x1b" in out + err
        assert not {"\x1b", "\x07", "\r", "\u202e"} & set(out + err)
        with h5py.File(tmp_path / "s.h5", "r+") as file:
            file["entry"].pop("\x1b[2J", None)


def test_verify_changes_nothing_and_says_which_poses_are_good(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("damaged", "interrupted", "complete"):
        path = folder / f"{name}.h5"
        before = path.read_bytes(), path.stat().st_mtime_ns
        run("verify", path)
        assert (path.read_bytes(), path.stat().st_mtime_ns) == before
    text = capsys.readouterr().out
    assert "is cut short: the last 100 of" in text
    assert "1 of 2 poses are good: 0\nnot captured: poses 1; halfangle resume" in text


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


@pytest.mark.parametrize("command", ["info", "verify", "list", "pack", "export"])
def test_the_help_of_each_command_shows_an_example(command: str) -> None:
    result = CliRunner().invoke(halfangle, ["session", command, "--help"])
    assert result.exit_code == 0
    assert f"Example: halfangle session {command} " in result.output


def test_documents_writes_a_line_for_each_document_and_nothing_over_another_file(
    session_path: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "coin.jsonl"
    assert run("documents", session_path, "-o", output) == 0
    names = [json.loads(line)[0] for line in output.read_text().splitlines()]
    assert names == ["start", "descriptor", "stream_resource", *["stream_datum", "event"] * 2, "stop"]
    assert f"{output}: {len(names)} documents" in capsys.readouterr().out
    assert run("documents", session_path, "-o", output) == 2
    assert "exists and is not overwritten" in capsys.readouterr().err
