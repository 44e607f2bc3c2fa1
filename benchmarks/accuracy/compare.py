"""A run against a kept one: a worse error beyond scatter is a regression, another speed is only told."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accuracy.rows import Row
from instrument.files.validation import InvalidInputError, Problem

RESULTS = Path(__file__).parents[1] / "results"
"""Where kept results are, `quick.json` and `full.json`."""

SAME = ("part", "scene", "method", "variant", "method_variant", "table", "n_views", "noise", "n_pixels", "repeat")
"""What makes two rows the same measurement."""

STATISTICS = {"mean_deg": "mean_se_deg", "median_deg": "median_se_deg", "share_above_5deg": "share_se"}
"""Errors that are compared, each with its standard error over pixels."""

LIMIT_SIGMA = 4.0
"""Standard errors beyond which a difference is no scatter: of 300 figures one in a hundred runs gets there."""

SAME_PIXELS_TOLERANCE = 0.05
"""Relative, of a mean or median on the very same pixels (one seed in both runs), where nothing scatters."""

SAME_PIXELS_SHARE = 0.002
"""The same of a share."""

SCENE_SCATTER = 0.35
"""Relative standard deviation of a relief's error from seed to seed: each is one draw of its materials."""

LAMBERTIAN = ("lambert", "trimmed")
"""Methods whose error on a relief depends on how glossy the materials drawn are: 0.2 to 2 deg, so it says nothing."""

LIMIT_METHODS, LIMIT_SCATTER = ("palette", "auto"), 0.12
"""Methods that come so near to the information limit of a relief that their error over it hardly scatters with the
seed, and the relative standard deviation of that ratio."""

SCENE_SHARE_SCATTER = 0.01
"""The same of the share above 5 deg, absolute."""

SPEED_TOLD = 0.25
"""Relative change of the median speed from which it is told."""


@dataclass(frozen=True)
class Comparison:
    """What came of it.

    Attributes
    ----------
    n_rows : int
        Rows that both runs have.
    regressions, notes : tuple of str
        One line each; notes are better errors and other speeds.
    """

    n_rows: int
    regressions: tuple[str, ...]
    notes: tuple[str, ...]


def kept_result(*, quick: bool) -> Path:
    """Return where the kept result of such a run is, or would be."""
    return RESULTS / ("quick.json" if quick else "full.json")


def read_report(path: Path) -> dict[str, Any]:
    """Read what `halfangle bench --json` wrote.

    Raises
    ------
    InvalidInputError
    """
    title = "The result to compare with cannot be read."
    try:
        report = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError, json.JSONDecodeError) as error:
        raise InvalidInputError(title, [Problem(str(path), str(error))]) from None
    rows = report.get("rows") if isinstance(report, dict) else None
    if not isinstance(rows, list) or not all(isinstance(row, dict) and set(SAME) <= set(row) for row in rows):
        what = "has no list `rows` as `halfangle bench --json` writes it; choose such a file"
        raise InvalidInputError(title, [Problem(str(path), what)])
    return dict(report)


def compare(new: dict[str, Any], old: dict[str, Any]) -> Comparison:
    """Compare the rows that two reports share."""
    before = {_key(row): row for row in old["rows"]}
    pairs = [(row, before[_key(row)]) for row in new["rows"] if _key(row) in before]
    regressions, notes = [], []
    for now, then in pairs:
        for name, allowed in compared(now, then):
            a, b = number(now, name), number(then, name)
            if np.isnan(b):
                # Nothing can be worse than not solved.
                continue
            text = f"{describe(now)}: {name} {b:.4g} -> {a:.4g}, scatter {allowed:.2g}"
            if np.isnan(a) or a > b + allowed:
                regressions.append(text)
            elif a < b - allowed:
                notes.append(f"better: {text}")
    return Comparison(len(pairs), tuple(regressions), (*notes, *_speeds(pairs)))


def compared(now: Row, then: Row) -> Iterator[tuple[str, float]]:
    """Yield the figures to compare, and by how much each may differ without meaning anything."""
    other_materials = now["scene"] == "relief" and now["seed"] != then["seed"]
    if other_materials and now["method"] in LAMBERTIAN:
        return
    for name in STATISTICS:
        yield name, scatter(now, then, name)
    known = not np.isnan([number(row, "over_known") for row in (now, then)]).any()
    if other_materials and known and now["method"] in LIMIT_METHODS:
        yield "over_known", LIMIT_SIGMA * 2.0**0.5 * LIMIT_SCATTER * number(then, "over_known")


def scatter(now: Row, then: Row, name: str) -> float:
    """Return by how much a figure may differ without meaning anything."""
    share = name == "share_above_5deg"
    level = number(then, name)
    if now["seed"] == then["seed"]:
        return SAME_PIXELS_SHARE if share else SAME_PIXELS_TOLERANCE * level
    error2 = number(now, STATISTICS[name]) ** 2 + number(then, STATISTICS[name]) ** 2
    # A share of zero has no standard error, yet one pixel may come over the limit.
    error2 = np.nan_to_num(error2) + (1.0 / max(now["n_pixels"], 1) ** 2 if share else 0.0)
    if now["scene"] == "relief":
        error2 += 2.0 * (SCENE_SHARE_SCATTER if share else SCENE_SCATTER * level) ** 2
    return float(LIMIT_SIGMA * np.sqrt(error2))


def describe(row: Row) -> str:
    """Return which measurement a row is."""
    unusual = "".join(f", {row[key]}" for key in ("variant", "method_variant") if row[key])
    return (
        f"{row['part']} {row['method']} ({row['table']}, {row['n_views']} views, {100 * row['noise']:g} %{unusual}, "
        f"{row['n_pixels']} pixels)"
    )


def number(row: Row, name: str) -> float:
    """Return a figure of a row; NaN where it is null or missing."""
    value = row.get(name)
    return float("nan") if value is None else float(value)


def _key(row: Row) -> tuple[Any, ...]:
    return tuple(row[name] for name in SAME)


def _speeds(pairs: list[tuple[Row, Row]]) -> list[str]:
    """Say of each method whose speed changed how much, by the median over its rows."""
    texts = []
    for method in sorted({now["method"] for now, _ in pairs}):
        own = [(now, then) for now, then in pairs if now["method"] == method]
        change = np.nanmedian([number(now, "pixels_per_s") / number(then, "pixels_per_s") for now, then in own])
        if not abs(change - 1.0) < SPEED_TOLD:
            texts.append(f"speed: {method} at {change:.2f} times the pixels a second of the kept run")
    return texts
