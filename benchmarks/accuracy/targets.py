"""The targets of the design, and how a run stands to them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from benchmarks.accuracy.compare import number
from benchmarks.accuracy.rows import Row
from benchmarks.accuracy.settings import LARGE, MEGAPIXEL, N_VIEWS, NOISE

LEVELS = ("must", "goal", "beyond")


@dataclass(frozen=True)
class Target:
    """One line of the targets: figures that must not exceed (or, for speeds, fall below) each level.

    Attributes
    ----------
    name : str
    figures : tuple of str
        Keys of the rows, averaged over the rows chosen.
    rows : callable
        Tells whether a row belongs to it.
    limits : tuple of tuple of float
        For each of `LEVELS` that is set, one limit a figure; NaN = none for this figure.
    larger_is_better : bool
    scale : tuple of float
        Factor of each figure for people, e.g. 100 for per cent.
    """

    name: str
    figures: tuple[str, ...]
    rows: Callable[[Row], bool]
    limits: tuple[tuple[float, ...], ...]
    larger_is_better: bool = False
    scale: tuple[float, ...] = ()

    def measured(self, rows: list[Row]) -> list[float]:
        """Return the figures, averaged over the rows chosen; empty if there is no such row."""
        own = [row for row in rows if self.rows(row)]
        return [float(np.mean([number(row, figure) for row in own])) for figure in self.figures] if own else []

    def met(self, values: list[float], level: int) -> bool:
        """Tell whether every figure keeps its limit of a level."""
        pairs = [(v, limit) for v, limit in zip(values, self.limits[level], strict=True) if not np.isnan(limit)]
        return all(v >= limit if self.larger_is_better else v <= limit for v, limit in pairs)

    def verdict(self, values: list[float]) -> str:
        """Say which level is met, and by how much the next is missed."""
        if not values:
            return "not in this run"
        best = max((i for i in range(len(self.limits)) if self.met(values, i)), default=-1)
        if best < 0:
            return f"**missed** {self._gap(values, 0)}"
        if best + 1 == len(self.limits):
            return f"{LEVELS[best]} met"
        return f"{LEVELS[best]} met, {LEVELS[best + 1]} missed {self._gap(values, best + 1)}"

    def _gap(self, values: list[float], level: int) -> str:
        ratios = [
            limit / v if self.larger_is_better else v / limit
            for v, limit in zip(values, self.limits[level], strict=True)
            if not np.isnan(limit) and v > 0.0 and limit > 0.0
        ]
        worst = max(ratios, default=float("nan"))
        return f"by a factor of {worst:.2f}"


def _is(method: str, part: str, n_views: int = N_VIEWS, variant: str = "") -> Callable[[Row], bool]:
    def chosen(row: Row) -> bool:
        same = row["method"] == method and row["part"] == part and row["variant"] == variant
        return bool(same and not row["method_variant"] and row["n_views"] == n_views and row["noise"] in {NOISE, 1e-6})

    return chosen


_BOTH = ("mean_deg", "median_deg")

_NONE = float("nan")

TARGETS = (
    Target(
        "independent pixels: mean / median normal error, deg",
        _BOTH,
        _is("generic", "independent"),
        ((0.45, 0.25), (0.36, 0.23), (0.30, 0.17)),
    ),
    Target(
        "relief, nothing given: mean / median, deg",
        _BOTH,
        _is("palette", "relief"),
        ((0.30, 0.22), (0.16, 0.115), (0.11, 0.085)),
    ),
    Target(
        "the same with 25 views",
        _BOTH,
        _is("palette", "relief", 25),
        ((0.50, 0.36), (0.27, 0.18), (0.22, 0.15)),
    ),
    Target(
        "the same with the light 60 mm off",
        _BOTH,
        _is("palette", "variants", variant="light 60 mm off"),
        ((0.42, 0.36), (0.27, 0.23), (0.13, 0.10)),
    ),
    Target(
        "the same with 10 % wrong samples: mean / median, deg; share above 5 deg, %",
        (*_BOTH, "share_above_5deg"),
        _is("palette", "variants", variant="10 % wrong samples"),
        ((0.60, 0.30, 0.03), (0.25, 0.12, 0.01), (0.15, _NONE, 0.003)),
        scale=(1.0, 1.0, 100.0),
    ),
    Target(
        "depth RMS / with the plane removed, mm",
        ("depth_rmse_mm", "depth_rmse_without_plane_mm"),
        _is("palette", "relief"),
        ((0.05, 0.02), (0.015, 0.006), (0.008, 0.003)),
    ),
    Target(
        "curve over the half angles seen, relative, %",
        ("curve_error",),
        _is("palette", "relief"),
        ((0.05,), (0.01,), (0.005,)),
        scale=(100.0,),
    ),
    Target(
        "generic solver, pixels a second",
        ("pixels_per_s",),
        _is("generic", "independent"),
        ((5e3,), (15e3,), (30e3,)),
        larger_is_better=True,
    ),
    Target(
        "generic solver, times the reference",
        ("ratio_to_reference",),
        _is("generic", "independent"),
        ((400.0,),),
        larger_is_better=True,
    ),
    Target(
        f"whole solve of {LARGE}, pixels a second",
        ("pixels_per_s",),
        _is("palette", "growth", variant=LARGE),
        ((5e3,), (30e3,), (150e3,)),
        larger_is_better=True,
    ),
    Target(
        "a megapixel, from the stack's file to the result's: seconds",
        ("seconds",),
        _is("palette", "growth", variant=MEGAPIXEL),
        ((240.0,), (60.0,), (10.0,)),
    ),
    Target(
        "its peak memory, MB",
        ("peak_mb",),
        _is("palette", "growth", variant=MEGAPIXEL),
        ((4096.0,), (2048.0,)),
    ),
    Target(
        "near-field plane at 350 mm, noise-free: mean, deg",
        ("mean_deg",),
        _is("generic", "hard", variant="plane at 350 mm, noise-free"),
        ((0.3,), (0.1,), (0.01,)),
    ),
)

COVERAGE = {"68 %": ("coverage68", ((0.60, 0.76), (0.64, 0.72))), "95 %": ("coverage95", ((0.90, 0.98), (0.93, 0.97)))}
"""For each stated interval the figure, and the range for ``must`` and for ``goal``."""

INTEGRATION = Target("integration of 4 megapixels, s", (), lambda _: False, ((0.15,), (0.08,)))
"""Measured apart, since it is no row."""


def judged(rows: list[Row], integration_seconds: float | None = None) -> Iterator[tuple[str, str, str, str]]:
    """Yield each target's name, its levels, what was measured and the verdict."""
    for target in TARGETS:
        values = target.measured(rows)
        scale = target.scale or (1.0,) * len(target.figures)
        levels = " · ".join(_numbers(limits, scale) for limits in target.limits)
        yield target.name, levels, _numbers(values, scale) if values else "-", target.verdict(values)
    seconds = [] if integration_seconds is None else [integration_seconds]
    levels = " · ".join(_numbers(limits, (1.0,)) for limits in INTEGRATION.limits)
    yield INTEGRATION.name, levels, _numbers(seconds, (1.0,)) if seconds else "-", INTEGRATION.verdict(seconds)
    yield from _paired(rows)
    yield from _coverage(rows)


def _paired(rows: list[Row]) -> Iterator[tuple[str, str, str, str]]:
    """Not worse than the reference on the very same pixels."""
    own = [row for row in rows if _is("generic", "independent")(row) and "paired_mean_deg" in row]
    name = "not worse than the reference on the same pixels: mean, deg"
    if not own:
        yield name, "reference's", "-", "not in this run"
        return
    ours, theirs = (float(np.mean([number(r, key) for r in own])) for key in _PAIRED)
    n = sum(int(row["paired_n_pixels"]) for row in own)
    verdict = "goal met" if ours < theirs else "**missed**"
    yield f"{name} ({n} pixels)", f"reference's {theirs:.3f}", f"{ours:.3f}", verdict


_PAIRED = ("paired_mean_deg", "paired_reference_mean_deg")


def _coverage(rows: list[Row]) -> Iterator[tuple[str, str, str, str]]:
    """Share of true normals within the stated intervals."""
    for method, part in (("generic", "independent"), ("palette", "relief")):
        own = [row for row in rows if _is(method, part)(row)]
        for interval, (key, ranges) in COVERAGE.items():
            levels = " · ".join(f"{100 * low:.0f}-{100 * high:.0f} %" for low, high in ranges)
            name = f"true normals within the stated {interval} interval, {method} on {part}"
            if not own:
                yield name, levels, "-", "not in this run"
                continue
            share = float(np.mean([number(row, key) for row in own]))
            met = [low <= share <= high for low, high in ranges]
            off = max(ranges[0][0] - share, share - ranges[0][1])
            verdict = "goal met" if met[1] else "must met" if met[0] else f"**missed** by {100 * off:.0f} points"
            yield name, levels, f"{100 * share:.0f} %", verdict


def _numbers(values: tuple[float, ...] | list[float], scale: tuple[float, ...]) -> str:
    scaled = (v * s for v, s in zip(values, scale, strict=True))
    return " / ".join("-" if np.isnan(v) else f"{v:.0f}" if v >= 100.0 else f"{v:.3g}" for v in scaled)
