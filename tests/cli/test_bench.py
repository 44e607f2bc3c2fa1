"""`halfangle bench`, run as a user runs it, on its fastest rows."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from benchmarks.accuracy.rows import KEYS
from cli.main import main

FAST = ("bench", "--quick", "--only", "independent/lambert", "-q")


def run(*arguments: str | Path) -> int:
    """Run `halfangle` and return its exit code."""
    with pytest.raises(SystemExit) as ended:
        main([str(argument) for argument in arguments])
    return int(ended.value.code or 0)


@pytest.mark.slow
def test_a_run_writes_rows_picture_and_page_and_compares_with_an_earlier_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder, again = tmp_path / "out", tmp_path / "again.json"
    run(*FAST, "--seed", "5", "-o", folder)
    assert "seed 5" in capsys.readouterr().out
    assert sorted(path.name for path in folder.iterdir()) == ["accuracy.md", "bench.json", "bench.png"]
    rows = json.loads((folder / "bench.json").read_text())["rows"]
    assert len(rows) == 6
    assert all(set(KEYS) <= set(row) and row["method"] == "lambert" and row["coverage68"] is None for row in rows)
    assert (folder / "bench.png").stat().st_size < 150_000
    assert "](bench.png)" in (folder / "accuracy.md").read_text()

    assert run(*FAST, "--seed", "5", "--json", again, "--compare", folder / "bench.json") == 0
    assert "6 rows compared with bench.json: 0 figures worse" in capsys.readouterr().out

    old = json.loads(again.read_text())
    for row in old["rows"]:
        row["mean_deg"] /= 2.0
    (tmp_path / "better.json").write_text(json.dumps(old))
    assert run(*FAST, "--seed", "5", "--compare", tmp_path / "better.json") == 1
    assert "worse: independent lambert" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--only", "reliefs"), "--only: names 'reliefs'; must be PART, METHOD or PART/METHOD"),
        (("--only", "growth"), "which is no row of this run"),
        (("--seed", "-1"), "-1 is not in the range 0<=x<=4294967295"),
        (("--compare", "nothing.json"), "No such file"),
        (("--json", "taken.json"), "exists and is not overwritten"),
        (("--json", "nowhere/rows.json"), "is no folder"),
        (("rows",), "unexpected extra argument"),
    ],
)
def test_bad_options_are_told_with_code_2_before_anything_is_run(
    arguments: tuple[str, ...],
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "taken.json").write_text("{}")
    assert run("bench", "--quick", *arguments) == 2
    assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.iterdir()] == ["taken.json"]


def test_results_of_an_earlier_run_are_not_overwritten(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "bench.png").write_text("")
    assert run("bench", "--quick", "-o", tmp_path) == 2
    assert "bench.png: exists and is not overwritten" in capsys.readouterr().err
