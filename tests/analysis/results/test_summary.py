from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import pytest

from analysis.results.summary import DepthShape, HeldOutView, Quantiles, SourceFile, Summary, value_from_json
from instrument.files.validation import InvalidInputError

LEAST = Summary(
    n_views=3,
    n_pixels=12,
    n_unsolved=1,
    theta_h_range_deg=(1.0, 30.0),
    normal_sigma_deg=Quantiles(0.1, 0.2, 0.3),
    relative_error=0.01,
)
WHOLE = replace(
    LEAST,
    depth_shape=DepthShape(*[0.5] * 7),
    light_offset_mm=(1.0, 2.0, 0.0),
    error_budget_deg={"image noise": 0.05},
    left_out=(HeldOutView(2, 10, 4, 0.01, 0.1, 40.0, 20.0, float("inf")),),
    options={"accuracy": "best"},
    source=SourceFile("a.stack.h5", "12ab"),
    calibration={"rms": 0.1, "dropped": ["pose 3"]},
)


@pytest.mark.parametrize("summary", [LEAST, WHOLE])
def test_a_summary_reads_back_as_it_was_written(summary: Summary):
    assert value_from_json(Summary, json.dumps(summary.as_dict()), "/entry/summary") == summary


def test_what_does_not_apply_has_no_key():
    assert set(LEAST.as_dict()) == {
        "n_views", "n_pixels", "n_unsolved", "theta_h_range_deg", "normal_sigma_deg", "relative_error", "left_out",
    }  # fmt: skip


def test_keys_of_a_later_version_are_no_matter():
    text = json.dumps(LEAST.as_dict() | {"something_new": [1, 2]})
    assert value_from_json(Summary, text, "/entry/summary") == LEAST


@pytest.mark.parametrize(
    ("changes", "where", "what"),
    [
        ({"n_views": "3"}, ".n_views", "is '3'; must be a whole number"),
        ({"relative_error": None}, ".relative_error", "is None; must be a number"),
        ({"theta_h_range_deg": [1.0]}, ".theta_h_range_deg[1]", "is missing"),
        ({"normal_sigma_deg": {"mean": 1.0, "median": 1.0}}, ".normal_sigma_deg.p95", "is missing"),
        ({"normal_sigma_deg": 3}, ".normal_sigma_deg", "is 3; must be values by name"),
        ({"left_out": {"view": 1}}, ".left_out", "must be a list"),
        ({"source": {"file": 1, "sha256": ""}}, ".source.file", "is 1; must be a text"),
    ],
)
def test_what_is_wrong_is_told_by_its_place(changes: dict[str, Any], where: str, what: str):
    with pytest.raises(InvalidInputError) as caught:
        value_from_json(Summary, json.dumps(LEAST.as_dict() | changes), "/entry/summary")
    assert [(p.where, what in p.what) for p in caught.value.problems] == [(f"/entry/summary{where}", True)]
