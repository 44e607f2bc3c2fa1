"""`halfangle calibrate` on sessions without boards, run as a user runs it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from cli.main import main
from tests.instrument.imports.folders import mosaic, write_dng


def run(*arguments: str | Path) -> int:
    """Run `halfangle` and return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


@pytest.fixture(scope="module")
def session(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two brackets of raw pictures, of which nothing is stated."""
    folder = tmp_path_factory.mktemp("leaf")
    for i in range(4):
        write_dng(folder / f"{i}.dng", mosaic(i), (0.01, 0.1)[i % 2])
    run("import", "--init", folder)
    assert run("import", folder, "-o", folder / "leaf.h5") == 0
    return folder / "leaf.h5"


def test_without_files_to_write_all_checks_are_told(session: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("calibrate", session, "-q") == 0
    shown = capsys.readouterr().out
    assert "PASS  values that are no numbers" in shown
    assert "calibration checks: 0 FAIL" in shown


def test_a_page_and_figures_are_written_without_a_stack(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("calibrate", session, "-q", "--report", tmp_path / "p.html", "--json", tmp_path / "f.json") == 0
    found = json.loads((tmp_path / "f.json").read_text())
    told = capsys.readouterr().out
    assert found["n_views"] == 0
    assert found["coverage"] is None
    for check in found["checks"]:
        assert check["name"] in (tmp_path / "p.html").read_text()
        assert (f"{check['status']}  {check['name']}: " in told) is (check["status"] != "PASS")


def test_a_page_that_is_there_is_refused_before_anything_is_done(
    session: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "p.html").write_text("mine")
    assert run("calibrate", session, "--report", tmp_path / "p.html", "--json", tmp_path / "f.json") == 2
    assert "exists and is not overwritten" in capsys.readouterr().err
    assert not (tmp_path / "f.json").exists()
