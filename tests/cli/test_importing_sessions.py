"""`halfangle import` without --registered: pictures become a session."""

from __future__ import annotations

from pathlib import Path

import pytest

from cli.main import main
from instrument.session.session import Session
from tests.instrument.imports.folders import mosaic, write_dng, write_png


def run(*arguments: str | Path) -> int:
    """Run `halfangle import` and return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main(["import", *(str(argument) for argument in arguments)])
    return int(ended.value.code or 0)


@pytest.fixture
def raw_folder(tmp_path: Path) -> Path:
    folder = tmp_path / "leaf"
    folder.mkdir()
    for i in range(4):
        write_dng(folder / f"{i}.dng", mosaic(i), (0.01, 0.1)[i % 2])
    return folder


def test_init_and_import_make_a_session_of_a_folder(
    raw_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("--init", raw_folder) == 0
    assert "complete it, then run: halfangle import" in capsys.readouterr().out
    assert run(raw_folder, "-o", tmp_path / "leaf.h5") == 0
    shown = capsys.readouterr().out
    for row in (
        "acme pocket",
        "64 x 48, 12 bits, RGGB",
        "2, 4 frames",
        "0.01, 0.1 s",
        "64, 65, 66, 67",
        "4095",
        "none",
    ):
        assert row in shown
    with Session(tmp_path / "leaf.h5") as session:
        assert session.pose_complete.tolist() == [True, True]


def test_init_keeps_a_file_that_is_there(raw_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (raw_folder / "capture.toml").write_text("mine")
    assert run("--init", raw_folder) == 2
    assert "exists and is not overwritten" in capsys.readouterr().err
    assert (raw_folder / "capture.toml").read_text() == "mine"


def test_a_session_that_is_there_is_kept(raw_folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    run("--init", raw_folder)
    (tmp_path / "leaf.h5").write_text("mine")
    assert run(raw_folder, "-o", tmp_path / "leaf.h5") == 2
    assert "exists and is not overwritten" in capsys.readouterr().err


def test_without_a_capture_file_the_way_to_one_is_shown(raw_folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(raw_folder, "-o", "leaf.h5") == 2
    assert f"halfangle import --init {raw_folder}" in capsys.readouterr().err


def test_notes_say_what_was_assumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_png(tmp_path / "a.png", mosaic(0))
    (tmp_path / "other.toml").write_text('name = "a"\n[grouping]\nexposure_times_s = [1.0]\n')
    assert run(tmp_path, "--capture", tmp_path / "other.toml", "-o", tmp_path / "a.h5") == 0
    shown = capsys.readouterr().out
    assert "note: the black level is taken to be 0" in shown
    assert "note: frames are taken to be monochrome" in shown
    assert "note: counts are taken to be 12 bits deep" in shown


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        (["--registered"], "--registered needs --positions, --width-mm, --output too"),
        (["--gamma", "2"], "--gamma is for --registered only"),
        (["--init", "-o", "x.h5"], "--output cannot go with --init"),
        (["--registered", "--init"], "--init cannot go with --registered"),
    ],
)
def test_options_that_do_not_go_together_are_refused(
    raw_folder: Path, capsys: pytest.CaptureFixture[str], options: list[str], expected: str
) -> None:
    assert run(raw_folder, *options) == 2
    assert expected in capsys.readouterr().err
