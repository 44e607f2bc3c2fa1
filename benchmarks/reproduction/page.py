"""docs/reproduction.md: each experiment's figures beside what the supplement states."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from benchmarks.reproduction.experiment import Experiment
from benchmarks.reproduction.run_experiment import load
from instrument.files.whole_file import write_whole

WIDTH = 120

MAX_ROWS = 16
"""Of a table on the page; a longer one stands in `table.csv` of the experiment's folder."""

Result = dict[str, Any]

INTRODUCTION = (
    "The experiments of the supplement to Hui et al., ICCV 2017 `[hui2017]`, run by `halfangle reproduce`, which also "
    "wrote this page. The 100 measured materials of MERL are not part of this project. In their stead stand two "
    "published tables of analytic fits to them, the dictionary from one and the test from the other, a material's own "
    "name left out: fits of metals differ by 40 to 90 %, and no fit has what a measurement has and a formula has not. "
    "With `--merl DIR` the measured files are used. What the supplement shows in a plot or a picture only is judged by "
    "its words."
)


def write_page(target: Path, folder: Path, results: Sequence[Result], summary: Result) -> None:
    """Write the page, and beside it the pictures that are not in its folder yet.

    Parameters
    ----------
    target : Path
        Markdown file.
    folder : Path
        Where `benchmarks.reproduction.reproduce` left what it found.
    results : sequence of dict
    summary : dict
        Says how it was run.
    """
    sections = [_section(result, load(result["name"]), _pictures(target, folder, result)) for result in results]
    size = "quick run" if summary["quick"] else "full run"
    ending = f"Seed {summary['seed']}, {size}, {sum(r['seconds'] for r in results) / 60:.0f} minutes in all."
    parts = ["# The paper, reproduced", _wrapped(INTRODUCTION), _wrapped(ending), _overview(results), *sections]
    write_whole(target, "\n\n".join(parts) + "\n", overwrite=True)


def _overview(results: Sequence[Result]) -> str:
    rows = [("experiment", "supplement", "ours", "verdict")]
    for result in results:
        told = result["ours"] if result["status"] == "ok" else result["why"]
        link = f"[{result['name']}](#{result['name']})"
        rows.append((link, load(result["name"]).source, told, result["verdict"] or result["status"]))
    return _table(rows)


def _section(result: Result, experiment: Experiment, pictures: Sequence[str]) -> str:
    parts = [f"## {experiment.name}", _wrapped(f"{experiment.title} ({experiment.source}).")]
    parts.append(_wrapped(f"**Stated:** {experiment.stated}"))
    if result["status"] == "ok":
        parts.append(_wrapped(f"**Ours:** {result['ours']}"))
        parts.append(_wrapped(f"**Verdict: {result['verdict']}.** {result['why']}"))
        parts += [f"![{experiment.title}]({picture})" for picture in pictures]
        parts += _rows(result)
    else:
        parts.append(_wrapped(f"**{result['status'].capitalize()}:** {result['why']}"))
    return "\n\n".join(parts)


def _rows(result: Result) -> Iterator[str]:
    rows = result["rows"]
    if 0 < len(rows) <= MAX_ROWS:
        yield _table([tuple(rows[0]), *(tuple(_cell(value) for value in row.values()) for row in rows)])
    elif rows:
        yield f"The table of {len(rows)} rows is `{result['name']}/table.csv` in the command's folder."


def _pictures(target: Path, folder: Path, result: Result) -> list[str]:
    """Return the links to an experiment's pictures; they are copied where the page is not in the folder."""
    found = [folder / result["name"] / name for name in result.get("figures", ())]
    if target.parent.resolve() == folder.resolve():
        return [f"{path.parent.name}/{path.name}" for path in found]
    beside = target.parent / "images" / "reproduction"
    if found:
        beside.mkdir(parents=True, exist_ok=True)
    return [_copied(path, beside / f"{result['name']}-{path.name}", target.parent) for path in found]


def _copied(source: Path, copy: Path, base: Path) -> str:
    write_whole(copy, source.read_bytes(), overwrite=True)
    return str(copy.relative_to(base))


def _cell(value: Any) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _table(rows: Sequence[Sequence[str]]) -> str:
    head, *others = ("| " + " | ".join(_escaped(cell) for cell in row) + " |" for row in rows)
    return "\n".join([head, "|" + "---|" * len(rows[0]), *others])


def _escaped(text: str) -> str:
    return text.replace("|", "\\|").replace("\n", " ")


def _wrapped(text: str) -> str:
    return textwrap.fill(text, WIDTH, break_long_words=False, break_on_hyphens=False)
