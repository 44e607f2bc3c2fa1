"""A run against a kept one: errors are judged, speeds are told."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.accuracy.compare import compare, read_report
from instrument.files.validation import InvalidInputError

ROW: dict[str, Any] = {
    "part": "independent",
    "scene": "independent",
    "method": "generic",
    "variant": "",
    "method_variant": "",
    "table": "sgd",
    "n_views": 65,
    "noise": 0.02,
    "n_pixels": 1000,
    "repeat": 0,
    "seed": 1,
    "mean_deg": 0.20,
    "mean_se_deg": 0.005,
    "median_deg": 0.15,
    "median_se_deg": 0.004,
    "share_above_5deg": 0.0,
    "share_se": 0.0,
    "pixels_per_s": 4000.0,
}


def report(**changes: Any) -> dict[str, Any]:
    return {"rows": [ROW | changes]}


def test_a_run_is_as_good_as_itself() -> None:
    found = compare(report(), report())
    assert (found.n_rows, found.regressions, found.notes) == (1, (), ())


@pytest.mark.parametrize(
    "worse", [{"mean_deg": 0.25}, {"median_deg": 0.18}, {"share_above_5deg": 0.05, "share_se": 0.007}]
)
def test_a_worse_error_is_a_regression_whatever_the_seed(worse: dict[str, float]) -> None:
    for seed in (1, 2):
        (text,) = compare(report(seed=seed, **worse), report()).regressions
        assert next(iter(worse)) in text
        assert "independent generic (sgd, 65 views, 2 %, 1000 pixels)" in text


def test_other_pixels_may_scatter_more_than_the_same_ones() -> None:
    assert compare(report(seed=2, mean_deg=0.225), report()).regressions == ()
    assert len(compare(report(seed=1, mean_deg=0.225), report()).regressions) == 1


def test_reliefs_of_other_seeds_scatter_with_their_materials() -> None:
    scene = {"part": "relief", "scene": "relief"}
    assert compare(report(seed=2, mean_deg=0.3, **scene), report(**scene)).regressions == ()
    assert len(compare(report(seed=2, mean_deg=3.0, **scene), report(**scene)).regressions) == 1


def test_a_palette_is_held_to_the_information_limit_of_its_relief() -> None:
    scene = {"part": "relief", "scene": "relief", "method": "palette"}
    near, far = report(over_known=1.1, **scene), report(seed=2, over_known=2.2, **scene)
    (text,) = compare(far, near).regressions
    assert "over_known 1.1 -> 2.2" in text
    assert compare(report(seed=2, over_known=None, **scene), near).regressions == ()


def test_a_lambertian_fit_is_not_held_to_another_draw_of_materials() -> None:
    scene = {"part": "relief", "scene": "relief", "method": "trimmed"}
    assert compare(report(seed=2, mean_deg=2.0, **scene), report(**scene)).regressions == ()
    assert len(compare(report(mean_deg=2.0, **scene), report(**scene)).regressions) == 1


def test_not_solved_at_all_is_a_regression() -> None:
    assert len(compare(report(mean_deg=None), report()).regressions) == 1
    assert compare(report(), report(mean_deg=None)).regressions == ()


def test_another_speed_is_told_and_no_regression() -> None:
    found = compare(report(pixels_per_s=400.0), report())
    assert found.regressions == ()
    assert found.notes == ("speed: generic at 0.10 times the pixels a second of the kept run",)


def test_a_better_error_is_told() -> None:
    (text,) = compare(report(mean_deg=0.1), report()).notes
    assert text.startswith("better: independent generic")


def test_rows_that_only_one_run_has_are_left_out() -> None:
    assert compare(report(n_views=25), report()).n_rows == 0


@pytest.mark.parametrize(
    ("text", "message"),
    [("{", "Expecting"), ("[]", "has no list `rows`"), ('{"rows": [{"mean_deg": 1}]}', "has no list `rows`")],
)
def test_a_file_that_is_no_result_is_refused(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "old.json"
    path.write_text(text)
    with pytest.raises(InvalidInputError, match="cannot be read") as caught:
        read_report(path)
    assert message in str(caught.value)


def test_a_result_is_read_back(tmp_path: Path) -> None:
    (tmp_path / "old.json").write_text(json.dumps(report()))
    assert compare(report(), read_report(tmp_path / "old.json")).n_rows == 1
