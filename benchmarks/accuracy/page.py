"""docs/accuracy.md: the benchmark's figures as a page, with targets beside them."""

from __future__ import annotations

import textwrap
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

from benchmarks.accuracy.compare import number
from benchmarks.accuracy.rows import Row
from benchmarks.accuracy.settings import N_VIEWS, NOISE, PARTS
from benchmarks.accuracy.targets import judged
from benchmarks.common.reference import FINEST_SPACING_DEG

WIDTH = 120
"""Longest line, tables apart."""

Column = tuple[str, Callable[[Row], str]]

METHOD_TEXTS = {
    "lambert": "least-squares Lambert on all views",
    "trimmed": "the same on the views whose residual is not among the largest",
    "reference": (
        "coarse-to-fine candidate normals, for each a `scipy` NNLS with the 99 other materials of the other published "
        f"table, {FINEST_SPACING_DEG:.2f} deg between the finest `[hui2017]`; one processor"
    ),
    "generic": (
        "every pixel on its own with the parametric dictionary; the noise level of independent pixels is found before "
        "the clock starts, a relief is solved from nothing, with its depth"
    ),
    "palette": "whole solve from nothing: palette found, shared and refined, all pixels, depth",
    "auto": "whole solve with the program's own choices",
    "known": (
        "information limit: true curves and depth given, from the true normals; with wrong samples no limit, but what "
        "the palette's robust loss makes of them"
    ),
}

NOT_TESTED = (
    "A real capture with known normals: there is none. All scenes are simulated, with the model's own assumptions on "
    "geometry: no interreflection, no cast shadow, no scattering below the surface, isotropic reflectance.",
    "Measured BRDFs: the materials are published fits of the 100 MERL materials. Neither table is the parametric "
    "dictionary's source, but both are smooth, and a measured material is not.",
    "Errors of the calibration beyond light power, offset and distance: lens distortion, wrong poses, blur between "
    "neighbours of a real picture, registration. The demo has some of them.",
    "Stacks of more than a megapixel.",
    "The pictures' response: radiances are linear here.",
    "Reliefs of other shapes: slopes reach about 20 deg, without steps or holes.",
)


def page(report: dict[str, Any], picture: str = "bench.png") -> str:
    """Return the page in Markdown.

    Parameters
    ----------
    report : dict
        What `benchmarks.accuracy.run.bench` returns, or `halfangle bench --json` wrote.
    picture : str
        The figure's path, as seen from the page.
    """
    rows = report["rows"]
    sections = [
        "# Accuracy and speed",
        wrapped(_about(report)),
        f"![Error against speed of every method]({picture})",
        "## Methods",
        bullets(f"**{name}**: {text}." for name, text in METHOD_TEXTS.items() if _has(rows, name)),
        "## Targets",
        wrapped(
            f"Judged at {N_VIEWS} views and {100 * NOISE:g} % noise unless the line says otherwise, as the mean over "
            "the rows of this run. Levels: must · goal · beyond."
        ),
        markdown(("target", "levels", "measured", "verdict"), list(judged(rows, report.get("integration_seconds")))),
        *_parts(rows),
        "## What must hold exactly",
        bullets(
            f"{check['name']}: {'yes' if check['passed'] else '**no**'} ({check['what']})" for check in report["checks"]
        ),
        "## What was not tested",
        bullets(NOT_TESTED),
        _again(report),
    ]
    return "\n\n".join(section for section in sections if section) + "\n"


def wrapped(text: str, indent: str = "") -> str:
    """Break a paragraph into lines of `WIDTH`, all but the first indented."""
    return textwrap.fill(text, WIDTH, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def bullets(texts: Iterable[str]) -> str:
    """Return a list in Markdown."""
    return "\n".join(wrapped(f"- {text}", "  ") for text in texts)


def markdown(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    lines = ["| " + " | ".join(cells) + " |" for cells in (head, *rows)]
    return "\n".join([lines[0], "|---" * len(head) + "|", *lines[1:]])


def _about(report: dict[str, Any]) -> str:
    machine = report["machine"]
    versions = ", ".join(f"{name} {v}" for name, v in report["versions"].items() if name != "halfangle")
    kind = "quick" if report["quick"] else "full"
    load = report.get("load")
    others = f"Before the run the machine had a load of {load:.1f}" if load is not None else "Its load is not known"
    return (
        f"Made by `halfangle bench` ({kind} run, seed {report['seed']}, {report['day']}, "
        f"{report['seconds'] / 60.0:.0f} min) on {machine['cores']} cores of {machine['cpu']}, Python "
        f"{machine['python']}, {versions}. All methods ran in one go on the same pixels; compilation is not timed. "
        f"{others}: what others compute meanwhile makes the pixels a second fewer. Speeds are pixels over wall clock, "
        "three channels, of the fastest of three runs where one takes less than a second. × reference is the ratio to "
        "the reference's speed in this run at the same number of views; a method may use all cores, the reference "
        "has one, so beside it stands the ratio of pixels per second of processor time."
    )


def _again(report: dict[str, Any]) -> str:
    option = " --quick" if report["quick"] else ""
    return (
        "## Again\n\n"
        f"```sh\nhalfangle bench{option} --seed {report['seed']} -o out\nhalfangle bench --quick\n```\n\n"
        + wrapped(
            "Without `--seed` the scenes are new ones. Every run is compared with the kept result in "
            "`benchmarks/results/`: an error that is worse beyond scatter fails, another speed is only told. "
            "`python -m benchmarks.accuracy.keep out` keeps a run, and makes this page from it."
        )
    )


def _parts(rows: list[Row]) -> Iterator[str]:
    for part, text in PARTS.items():
        own = [row for row in rows if row["part"] == part]
        if not own:
            continue
        yield f"## {part.capitalize()}: {text}"
        if part in {"independent", "relief"}:
            for noise in sorted({row["noise"] for row in own}, reverse=True):
                yield f"Noise {100 * noise:g} %:"
                yield _table([row for row in own if row["noise"] == noise], _columns(part))
        else:
            yield _table(own, _columns(part))


def _columns(part: str) -> list[Column]:
    what: list[Column] = [("method", lambda row: row["method"])]
    if part not in {"independent", "relief"}:
        what.append(("case", lambda row: ", ".join(t for t in (row["variant"], row["method_variant"]) if t) or "-"))
    if part in {"independent", "ablation", "hard", "poses"}:
        what.append(("materials", lambda row: row["table"] if row["scene"] == "independent" else "relief"))
    if part != "ablation":
        what.append(("views", lambda row: str(row["n_views"])))
    what += [
        ("mean", _figure("mean_deg")),
        ("median", _figure("median_deg")),
        ("95 %", _figure("p95_deg")),
        *([("× limit", _figure("over_known"))] if part in {"independent", "relief", "variants"} else []),
        ("> 5 deg, %", _figure("share_above_5deg", 100.0)),
        ("pixels/s", _figure("pixels_per_s")),
        ("× reference", _figure("ratio_to_reference")),
        ("× per CPU s", _figure("cpu_ratio_to_reference")),
        ("68 / 95 % hold", _coverage),
        ("curve, %", _figure("curve_error", 100.0)),
    ]
    if part in {"relief", "variants"}:
        what.append(("depth, mm", _figure("depth_rmse_mm")))
        what.append(("less plane", _figure("depth_rmse_without_plane_mm")))
    if part == "independent":
        what.append(("on the reference's pixels", _paired))
    if part == "growth":
        what.append(("peak, MB", _figure("peak_mb")))
        what.append(("radiance, MB", _figure("radiance_mb")))
    return what


def _table(rows: list[Row], columns: list[Column]) -> str:
    return markdown([name for name, _ in columns], [[text(row) for _, text in columns] for row in rows])


def _figure(name: str, scale: float = 1.0) -> Callable[[Row], str]:
    def text(row: Row) -> str:
        value = number(row, name) * scale
        if np.isnan(value):
            return "-"
        return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"

    return text


def _coverage(row: Row) -> str:
    inside = number(row, "coverage68"), number(row, "coverage95")
    return "-" if np.isnan(inside[0]) else f"{100 * inside[0]:.0f} / {100 * inside[1]:.0f}"


def _paired(row: Row) -> str:
    if "paired_mean_deg" not in row:
        return "-"
    ours, theirs = row["paired_mean_deg"], row["paired_reference_mean_deg"]
    share = 100.0 * row["paired_better_than_reference"]
    return f"{ours:.3f} to its {theirs:.3f} ({row['paired_n_pixels']}; better on {share:.0f} %)"


def _has(rows: list[Row], method: str) -> bool:
    return any(row["method"] == method for row in rows)
