"""What a run consists of, and what it hands back."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.accuracy.compare import SAME, STATISTICS, compare, kept_result, read_report
from benchmarks.accuracy.page import page
from benchmarks.accuracy.pareto import pareto, points
from benchmarks.accuracy.rows import KEYS
from benchmarks.accuracy.run import add_ratios, bench, head, selected
from benchmarks.accuracy.settings import NOISE, PARTS, QUICK_PARTS, Setting, entries, settings
from benchmarks.accuracy.targets import TARGETS, judged
from instrument.files.json_file import write_json
from instrument.files.validation import InvalidInputError

NONE = float("nan")


@pytest.fixture(scope="module")
def report() -> dict[str, Any]:
    methods = entries("reference", "lambert", "trimmed", "generic", "known")
    tiny = [
        Setting("independent", "independent", methods, size=6, n_views=16),
        Setting("relief", "relief", entries("trimmed", "known"), size=12, n_views=16),
    ]
    return bench(tiny, seed=7) | {"quick": True, "only": ""}


def test_every_row_has_the_columns_that_others_read(report: dict[str, Any]) -> None:
    for row in report["rows"]:
        assert set(KEYS) <= set(row)
        assert {*SAME, *STATISTICS, *STATISTICS.values()} <= set(row)
        assert isinstance(row["n_pixels"], int)
        assert row["seed"] == 7
        assert row["pixels_per_s"] > 0.0


def test_methods_are_paired_with_the_reference_on_its_pixels(report: dict[str, Any]) -> None:
    generic = next(row for row in report["rows"] if row["method"] == "generic")
    assert generic["paired_n_pixels"] == 6
    assert generic["ratio_to_reference"] > 20.0
    reference = next(row for row in report["rows"] if row["method"] == "reference")
    assert reference["ratio_to_reference"] == pytest.approx(1.0)
    assert reference["coverage68"] != reference["coverage68"]


def test_what_must_hold_exactly_holds(report: dict[str, Any]) -> None:
    assert [check["name"] for check in report["checks"] if not check["passed"]] == []
    assert len(report["checks"]) == 4


def test_a_report_says_on_what_and_with_what_it_was_taken(report: dict[str, Any]) -> None:
    assert report["machine"]["cpu"]
    assert report["machine"]["cores"] >= 1
    assert {"numpy", "scipy", "numba", "halfangle"} <= set(report["versions"])


def test_the_page_of_a_run_names_targets_and_what_was_not_tested(report: dict[str, Any], tmp_path: Path) -> None:
    write_json(tmp_path / "bench.json", report)
    text = page(read_report(tmp_path / "bench.json"))
    assert "nan" not in text
    assert max(len(line) for line in text.splitlines() if not line.startswith("|")) <= 120
    for title in ("## Targets", "## What was not tested", "seed 7", "[hui2017]", "halfangle bench --quick --seed 7"):
        assert title in text
    assert "not in this run" in text


def test_the_same_seed_gives_the_same_errors(report: dict[str, Any], tmp_path: Path) -> None:
    write_json(tmp_path / "bench.json", report)
    found = compare(report, read_report(tmp_path / "bench.json"))
    assert found.n_rows == len(report["rows"])
    assert found.regressions == ()


def test_the_picture_has_a_panel_for_each_scene_of_the_run(report: dict[str, Any]) -> None:
    assert len(pareto(report["rows"]).axes) == 2
    assert len(pareto([row for row in report["rows"] if row["scene"] == "independent"]).axes) == 1
    assert len(pareto([]).axes) == 2


def test_points_are_averaged_over_tables() -> None:
    rows = [{"noise": 0.01, "pixels_per_s": speed, "mean_deg": 0.1 * speed} for speed in (1.0, 3.0)]
    assert list(points(rows)) == [(0.01, 2.0, pytest.approx(0.2))]


def test_ratios_are_taken_at_the_same_number_of_views() -> None:
    rows = [
        {"method": method, "method_variant": "", "n_views": n, "pixels_per_s": speed, "n_pixels": 1, "cpu_seconds": 1.0}
        for method, n, speed in (("reference", 25, 20.0), ("reference", 65, 10.0), ("generic", 65, 50.0))
    ]
    add_ratios(rows, seed=0)
    assert [row["ratio_to_reference"] for row in rows] == [1.0, 1.0, 5.0]


@pytest.mark.parametrize("quick", [True, False])
def test_no_two_rows_of_a_run_are_the_same_measurement(quick: bool) -> None:
    heads = [
        head(setting, entry, 0) | {"n_pixels": entry.n_pixels or setting.size}
        for setting in settings(quick=quick)
        for entry in setting.entries
    ]
    keys = [tuple(row[name] for name in SAME) for row in heads]
    assert len(keys) == len(set(keys))


def test_the_full_run_has_every_part_and_all_levels_of_noise() -> None:
    full = list(settings(quick=False))
    assert {setting.part for setting in full} == set(PARTS)
    assert {s.noise for s in full if s.part == "relief"} == {0.005, 0.01, NOISE}
    assert {s.n_views for s in full if s.part == "independent"} == {10, 25, 65, 100}
    assert {s.part for s in settings(quick=True)} == set(QUICK_PARTS)


def test_every_target_is_judged_by_rows_of_the_full_run() -> None:
    rows = [head(setting, entry, 0) for setting in settings(quick=False) for entry in setting.entries]
    assert [target.name for target in TARGETS if not any(target.rows(row) for row in rows)] == []


def test_a_target_says_what_is_met_and_what_is_missed() -> None:
    target = TARGETS[0]
    assert target.verdict([0.40, 0.24]) == "must met, goal missed by a factor of 1.11"
    assert target.verdict([0.9, 0.2]) == "**missed** by a factor of 2.00"
    assert target.verdict([0.1, 0.1]) == "beyond met"
    assert target.verdict([]) == "not in this run"
    assert all(len(line) == 4 for line in judged([]))
    assert (
        "integration of 4 megapixels, s",
        "0.15 · 0.08",
        "0.1",
        "must met, goal missed by a factor of 1.25",
    ) in list(judged([], 0.1))


@pytest.mark.parametrize(
    ("only", "expected"),
    [
        ("", {("independent", "generic"), ("relief", "palette")}),
        ("relief", {("relief", "palette")}),
        ("generic", {("independent", "generic")}),
        ("relief/palette, independent/generic", {("independent", "generic"), ("relief", "palette")}),
    ],
)
def test_only_keeps_the_rows_that_it_names(only: str, expected: set[tuple[str, str]]) -> None:
    every = [
        Setting("independent", "independent", entries("generic"), 4),
        Setting("relief", "relief", entries("palette"), 4),
    ]
    assert {(s.part, e.method) for s in selected(every, only) for e in s.entries} == expected


def test_words_of_only_that_mean_nothing_are_told_together() -> None:
    with pytest.raises(InvalidInputError, match="Nothing was run") as caught:
        selected(settings(quick=True), "reliefs,relief/best,hard")
    told = str(caught.value)
    assert "'reliefs'" in told
    assert "'relief/best'" in told
    with pytest.raises(InvalidInputError, match="the quick run has the parts independent, relief"):
        selected(settings(quick=True), "hard")


def test_kept_results_are_results() -> None:
    for path in (kept_result(quick=True), kept_result(quick=False)):
        assert read_report(path)["rows"]


def test_every_kept_result_says_where_its_figures_come_from() -> None:
    for path in kept_result(quick=True).parent.glob("*.json"):
        assert {"day", "machine", "versions", "seed", "rows"} <= set(json.loads(path.read_text()))
