"""How experiments are run, found again and told of; what they measure is tested beside each."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks.reproduction import page as reproduction_page
from benchmarks.reproduction import reproduce, run_experiment
from benchmarks.reproduction.experiment import Experiment, Finding, Request, SkippedError, Verdict
from benchmarks.reproduction.run_experiment import run
from instrument.files.validation import InvalidInputError


def finding(request: Request) -> Finding:
    (request.folder / "curve.png").write_bytes(b"png")
    rows = [{"material": "brass", "error": np.float64(0.25)}, {"material": "teflon", "error": 0.5}]
    return Finding("median error 25 %", Verdict.EQUAL, "It is as stated.", rows, [request.folder / "curve.png"])


def skip(_: Request) -> Finding:
    raise SkippedError("needs Mitsuba. Install it")


def stumble(_: Request) -> Finding:
    raise ZeroDivisionError("no samples")


def experiment(act: Any) -> Experiment:
    return Experiment("slices", "fig. 4", "Curves beside the truth", "closely match", act)


@pytest.fixture
def request_(tmp_path: Path) -> Request:
    folder = tmp_path / "slices"
    folder.mkdir()
    return Request(folder, quick=True, seed=1)


def test_what_an_experiment_finds_is_kept_with_its_table(request_: Request):
    result = run(experiment(finding), request_)
    assert (result["status"], result["verdict"], result["figures"]) == ("ok", "equal", ["curve.png"])
    assert (request_.folder / "table.csv").read_text().splitlines() == ["material,error", "brass,0.25", "teflon,0.5"]
    assert result["seconds"] >= 0.0


@pytest.mark.parametrize(
    ("act", "status", "why"),
    [(skip, "skipped", "needs Mitsuba. Install it"), (stumble, "failed", "ZeroDivisionError: no samples")],
)
def test_one_that_cannot_be_run_says_why_and_stops_no_other(request_: Request, act: Any, status: str, why: str):
    result = run(experiment(act), request_)
    assert (result["status"], result["why"]) == (status, why)
    assert (request_.folder / "error.txt").exists() == (status == "failed")


def test_a_name_that_is_none_is_refused_with_those_that_there_are():
    with pytest.raises(InvalidInputError) as caught:
        reproduce.check_names(["slices", "slics", "methds"])
    assert [problem.where for problem in caught.value.problems] == ["slics", "methds"]
    assert "identifiability, images, slices" in caught.value.problems[0].what


def run_all(folder: Path, **changes: Any) -> list[dict[str, Any]]:
    return list(reproduce.reproduce(["slices"], folder, **{"quick": True, "seed": 1, **changes}))


@pytest.fixture
def runs(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Names of the processes that would have been started; each finds something."""
    started: list[str] = []

    def start(command: list[str], check: bool) -> Any:
        started.append(command[-2])
        run_experiment.main(command[-2], Path(command[-1]))
        return type("Ended", (), {"returncode": 0})

    monkeypatch.setattr(reproduce.subprocess, "run", start)
    monkeypatch.setattr(run_experiment, "load", lambda name: experiment(finding))
    return started


def test_what_was_run_in_the_same_way_is_not_run_again(tmp_path: Path, runs: list[str]):
    first, second = run_all(tmp_path), run_all(tmp_path)
    assert runs == ["slices"]
    assert first == second


@pytest.mark.parametrize("change", [{"quick": False}, {"seed": 2}, {"merl": Path("merl")}])
def test_what_was_run_in_another_way_is_run_anew(tmp_path: Path, runs: list[str], change: dict[str, Any]):
    run_all(tmp_path)
    run_all(tmp_path, **change)
    assert len(runs) == 2


def test_other_code_is_another_experiment(tmp_path: Path, runs: list[str], monkeypatch: pytest.MonkeyPatch):
    run_all(tmp_path)
    monkeypatch.setattr(reproduce, "code_digest", lambda: "other")
    run_all(tmp_path)
    assert len(runs) == 2


@pytest.mark.parametrize("torn", ["", '{"status": "ok"', "[]"])
def test_a_result_that_was_cut_short_is_run_anew(tmp_path: Path, runs: list[str], torn: str):
    run_all(tmp_path)
    (tmp_path / "slices" / "result.json").write_text(torn)
    assert run_all(tmp_path)[0]["status"] == "ok"
    assert len(runs) == 2


def test_a_process_that_dies_is_a_failure(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    died = type("Ended", (), {"returncode": -6})
    monkeypatch.setattr(reproduce.subprocess, "run", lambda *_, **__: died)
    (result,) = run_all(tmp_path)
    assert (result["status"], result["why"]) == ("failed", "its process ended with code -6 and no result")


@pytest.fixture
def page(tmp_path: Path, request_: Request, monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.setattr(reproduction_page, "load", lambda name: experiment(finding))
    results = [json.loads(json.dumps(run(experiment(act), request_), default=float)) for act in (finding, skip)]

    def write(target: Path) -> str:
        reproduction_page.write_page(target, tmp_path, results, {"quick": True, "seed": 1})
        return target.read_text()

    return write


def test_the_page_tells_ours_the_stated_and_the_verdict_with_a_picture(page: Any, tmp_path: Path):
    text = page(tmp_path / "reproduction.md")
    assert "| [slices](#slices) | fig. 4 | median error 25 % | equal |" in text
    assert "**Verdict: equal.** It is as stated." in text
    assert "| brass | 0.25 |" in text
    assert "![Curves beside the truth](slices/curve.png)" in text
    assert "**Skipped:** needs Mitsuba. Install it" in text


def test_a_page_elsewhere_brings_its_pictures_along(page: Any, tmp_path: Path):
    docs = tmp_path / "docs"
    docs.mkdir()
    assert "(images/reproduction/slices-curve.png)" in page(docs / "reproduction.md")
    assert (docs / "images" / "reproduction" / "slices-curve.png").exists()
