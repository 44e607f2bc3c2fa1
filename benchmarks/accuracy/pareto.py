"""The picture of the benchmark: error over speed, the reference and the information limit drawn in."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from benchmarks.accuracy.compare import number
from benchmarks.accuracy.rows import Row
from benchmarks.accuracy.settings import N_VIEWS
from instrument.files.whole_file import written_whole

COLOURS = {
    "lambert": "#888888",
    "trimmed": "#c08030",
    "reference": "#b03030",
    "generic": "#2060b0",
    "palette": "#208040",
    "known": "#000000",
}

MARKERS = ("o", "s", "^", "D")
"""Of the noise levels, ascending."""

TITLES = {"independent": "independent pixels, two tables of materials", "relief": "relief, mixed materials"}

DPI = 100


def pareto(rows: list[Row]) -> Figure:
    """Draw mean error over pixels a second at `N_VIEWS` views (or the most there are), one panel a scene."""
    plain = [row for row in rows if row["part"] == row["scene"]]
    views = {row["n_views"] for row in plain}
    n_views = N_VIEWS if N_VIEWS in views else max(views, default=N_VIEWS)
    plain = [row for row in plain if row["n_views"] == n_views]
    speed = [number(row, "pixels_per_s") for row in plain if row["method"] == "reference"]
    noises = sorted({row["noise"] for row in plain})
    shown = [scene for scene in TITLES if any(row["scene"] == scene for row in plain)] or list(TITLES)
    figure = Figure(figsize=(5.0 * len(shown), 4.4), layout="constrained")
    axes = figure.subplots(1, len(shown), sharex=True, sharey=True, squeeze=False)[0]
    for ax, scene in zip(axes, shown, strict=True):
        ax.set(xscale="log", yscale="log", xlabel="pixels a second")
        ax.set_title(TITLES[scene], fontsize=10)
        ax.grid(visible=True, which="both", alpha=0.25)
        own = [row for row in plain if row["scene"] == scene]
        for method, colour in COLOURS.items():
            _draw(ax, [row for row in own if row["method"] == method], method, colour, noises)
        if speed and scene == "relief":
            ax.axvline(float(np.mean(speed)), color=COLOURS["reference"], linestyle=":", label="speed of the reference")
        if ax.get_legend_handles_labels()[0]:
            ax.legend(fontsize=8)
    axes[0].set_ylabel(f"mean normal error, deg ({n_views} views)")
    levels = ", ".join(f"{marker} {100 * noise:g} %" for marker, noise in zip("●■▲◆", noises, strict=False))
    figure.suptitle(f"Error against speed; noise {levels}", fontsize=10)
    return figure


def write_pareto(path: Path, report: dict[str, Any]) -> None:
    """Draw `pareto` into a new PNG."""
    with written_whole(path) as part:
        pareto(report["rows"]).savefig(part, dpi=DPI, format="png")


def points(rows: list[Row]) -> Iterator[tuple[float, float, float]]:
    """Yield noise, pixels a second and mean error of one method, averaged over tables and repeats."""
    for noise in sorted({row["noise"] for row in rows}):
        own = [row for row in rows if row["noise"] == noise]
        speed, error = ([number(row, name) for row in own] for name in ("pixels_per_s", "mean_deg"))
        yield noise, float(np.mean(speed)), float(np.mean(error))


def _draw(ax: Axes, rows: list[Row], method: str, colour: str, noises: list[float]) -> None:
    if not rows:
        return
    found = [point for point in points(rows) if np.isfinite(point).all() and point[1] > 0.0]
    if method == "known":
        # A limit is a line: no method is this fast with nothing given, none can be better.
        for noise, _, error in found:
            label = "information limit, by noise" if noise == found[-1][0] else None
            ax.axhline(error, color=colour, linestyle="--", linewidth=0.8, label=label)
        return
    ax.plot([p[1] for p in found], [p[2] for p in found], color=colour, linewidth=0.8, alpha=0.6)
    for noise, speed, error in found:
        marker = MARKERS[noises.index(noise) % len(MARKERS)]
        label = method if noise == found[-1][0] else None
        ax.plot([speed], [error], marker, color=colour, markersize=7, linestyle="none", label=label)
