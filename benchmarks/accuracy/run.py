"""Running the benchmark: settings to rows, with what is needed to judge them."""

from __future__ import annotations

import os
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import Any, TypeAlias

import numpy as np

from analysis.evaluation.metrics import angular_error_deg
from analysis.stages import Track, peak_memory_mb, untracked
from benchmarks.accuracy.checks import checks
from benchmarks.accuracy.rows import Row, paired, score
from benchmarks.accuracy.settings import N_VIEWS, NOISE, PARTS, QUICK_PARTS, Entry, Setting
from benchmarks.common.methods import METHODS, Estimate, Method
from benchmarks.common.origin import origin
from benchmarks.common.scenes import Scene, independent, relief
from benchmarks.speed.integration import fastest_seconds
from instrument.files.validation import InvalidInputError, Problem

Report: TypeAlias = dict[str, Any]

N_TIMED = 16
"""Pixels of the reference when none of the rows asks for it, for the ratios."""

N_WARM_VIEWS = 25

SHORT_SECONDS = 1.0


def bench(
    chosen: list[Setting], seed: int, announce: Callable[[str], None] = lambda _: None, track: Track = untracked
) -> Report:
    """Run settings; return rows, checks, and what is needed to judge and to repeat them.

    Parameters
    ----------
    chosen : list of Setting
    seed : int
    announce : callable
        Called with a line about each row as it is ready.
    track : Track
        Learns how many settings are done.
    """
    begin, load = time.perf_counter(), os.getloadavg()[0] if hasattr(os, "getloadavg") else None
    announce("compiling")
    warm_up({(setting.scene, entry.method) for setting in chosen for entry in setting.entries})
    rows: list[Row] = []
    for setting in track(chosen):
        rows += run_setting(setting, seed, announce)
    add_ratios(rows, seed)
    report: Report = {"seed": seed} | origin() | {"load": load, "rows": rows}
    report["integration_seconds"] = fastest_seconds()
    report["checks"] = [asdict(check) for check in checks(seed)]
    return report | {"seconds": time.perf_counter() - begin, "peak_mb": peak_memory_mb()}


def selected(every: Iterable[Setting], only: str) -> list[Setting]:
    """Keep the rows that `only` names: part, scene or method, or part/method, separated by commas; all if empty.

    Raises
    ------
    InvalidInputError
    """
    every = list(every)
    wanted = [word.strip() for word in only.split(",") if word.strip()]
    if not wanted:
        return every
    problems = [Problem("--only", what) for word in wanted if (what := _misnamed(word))]
    kept = []
    for setting in every:
        entries = tuple(e for e in setting.entries if any(_names(word, setting, e) for word in wanted))
        if entries:
            kept.append(Setting(**{**vars(setting), "entries": entries}))
    if not problems and not kept:
        what = f"is {only!r}, which is no row of this run; the quick run has the parts {', '.join(QUICK_PARTS)}"
        problems.append(Problem("--only", what))
    if problems:
        raise InvalidInputError("Nothing was run.", problems)
    return kept


def _misnamed(word: str) -> str:
    """Say what is wrong with a word of `only`, or nothing."""
    first, _, second = word.partition("/")
    if (first in PARTS and (not second or second in METHODS)) or (first in METHODS and not second):
        return ""
    parts, methods = ", ".join(PARTS), ", ".join(METHODS)
    return f"names {word!r}; must be PART, METHOD or PART/METHOD with a part of {parts} and a method of {methods}"


def _names(word: str, setting: Setting, entry: Entry) -> bool:
    first, _, second = word.partition("/")
    if first in METHODS:
        return entry.method == first
    # A part that is a scene too means its rows in that part only.
    return setting.part == first and second in {"", entry.method}


def warm_up(used: set[tuple[str, str]]) -> None:
    """Run every (scene, method) once on a tiny scene, so that what is compiled or loaded is not timed."""
    tiny = {"independent": independent(2, N_WARM_VIEWS, NOISE, 0), "relief": relief(24, N_WARM_VIEWS, NOISE, 0)}
    for scene, method in sorted(used):
        METHODS[method](tiny[scene])


def run_setting(setting: Setting, seed: int, announce: Callable[[str], None]) -> list[Row]:
    """Run all methods on one scene."""
    scene = setting.make(seed)
    rows, errors = [], []
    for entry in setting.entries:
        part = scene if entry.n_pixels is None else scene.first(entry.n_pixels)
        estimate = fastest(entry.solve, part)
        row = head(setting, entry, seed) | score(part, estimate)
        rows.append(row)
        errors.append(_error(part, estimate))
        announce(line(row))
    _pair(setting, rows, errors)
    _set_against_limit(rows)
    return rows


def fastest(solve: Method, scene: Scene) -> Estimate:
    """Solve; where it takes less than a second, take the fastest of three times."""
    estimate = solve(scene)
    if estimate.seconds < SHORT_SECONDS:
        estimate = min((estimate, solve(scene), solve(scene)), key=lambda found: found.seconds)
    return estimate


def _error(scene: Scene, estimate: Estimate) -> np.ndarray[Any, np.dtype[np.float64]]:
    return angular_error_deg(estimate.normals, scene.normals)


def _pair(setting: Setting, rows: list[Row], errors: list[np.ndarray[Any, np.dtype[np.float64]]]) -> None:
    """Compare every method with the reference on the reference's pixels."""
    names = [entry.method for entry in setting.entries]
    if "reference" not in names:
        return
    theirs = errors[names.index("reference")]
    for row, ours in zip(rows, errors, strict=True):
        if row["method"] != "reference":
            row.update(paired(ours[: len(theirs)], theirs))


def _set_against_limit(rows: list[Row]) -> None:
    """State every mean error over that of the information limit, where it was measured."""
    limits = [row["mean_deg"] for row in rows if row["method"] == "known"]
    for row in rows:
        row["over_known"] = row["mean_deg"] / limits[0] if limits and limits[0] > 0.0 else np.nan


def head(setting: Setting, entry: Entry, seed: int) -> Row:
    """Return what a row says about its scene and method."""
    options = setting.options
    row: Row = {"part": setting.part, "scene": setting.scene, "method": entry.method}
    row |= {"variant": setting.variant, "method_variant": entry.variant, "table": setting.table}
    row |= {"n_views": setting.n_views, "noise": setting.noise, "ratio_to_reference": np.nan}
    row |= {"seed": seed + setting.repeat, "repeat": setting.repeat}
    if setting.scene == "relief":
        row |= {"offset_mm": options.get("offset_mm", 12.0), "wrong": options.get("wrong", 0.0)}
        row["n_materials"] = options.get("n_materials", 5)
    return row


def line(row: Row) -> str:
    """Return a row as a line of text."""
    what = " ".join(str(row[key]) for key in ("part", "method") if row[key])
    unusual = ", ".join(text for text in (row["variant"], row["method_variant"]) if text)
    return (
        f"{what}: {row['n_views']} views, {100 * row['noise']:g} % noise, {row['table']}"
        f"{', ' + unusual if unusual else ''}: mean {row['mean_deg']:.3f}, median {row['median_deg']:.3f} deg, "
        f"{row['pixels_per_s']:.0f} pixels/s"
    )


def add_ratios(rows: list[Row], seed: int) -> None:
    """State every speed against the reference's at the same number of views, or the nearest."""
    measured: dict[int, list[float]] = {}
    cpu: dict[int, list[float]] = {}
    for row in rows:
        if row["method"] == "reference" and not row["method_variant"]:
            measured.setdefault(row["n_views"], []).append(row["pixels_per_s"])
            cpu.setdefault(row["n_views"], []).append(row["n_pixels"] / row["cpu_seconds"])
    if not measured:
        scene = independent(N_TIMED, N_VIEWS, NOISE, seed)
        estimate = METHODS["reference"](scene)
        measured, cpu = {N_VIEWS: [N_TIMED / estimate.seconds]}, {N_VIEWS: [N_TIMED / estimate.cpu_seconds]}
    for row in rows:
        nearest = min(measured, key=lambda n: abs(n - row["n_views"]))
        row["ratio_to_reference"] = row["pixels_per_s"] / float(np.mean(measured[nearest]))
        if row["cpu_seconds"] > 0.0:
            row["cpu_ratio_to_reference"] = row["n_pixels"] / row["cpu_seconds"] / float(np.mean(cpu[nearest]))
