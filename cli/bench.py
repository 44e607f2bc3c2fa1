"""`halfangle bench`: accuracy and speed on simulated scenes."""

from __future__ import annotations

import secrets
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cli.output import check_new, write_json
from cli.progress import run_bar
from instrument.files.text_table import text_table

if TYPE_CHECKING:
    from benchmarks.accuracy.compare import Comparison

FILE = click.Path(path_type=Path, dir_okay=False)
FILES = ("bench.json", "bench.png", "accuracy.md")
MAX_SEED = 2**32 - 1


@click.command(epilog="Example: halfangle bench --quick -o out")
@click.option("--quick", is_flag=True, help="Two minutes instead of half an hour: fewer settings, smaller scenes.")
@click.option("--json", "json_file", type=FILE, help="Write the rows here.")
@click.option(
    "-o",
    "--output",
    "folder",
    type=click.Path(path_type=Path, file_okay=False),
    help=f"Folder for {', '.join(FILES)}.",
)
@click.option("--seed", type=click.IntRange(0, MAX_SEED), help="Of the scenes [default: a fresh one].")
@click.option(
    "--only",
    default="",
    metavar="ROWS",
    help="Rows to run: PART, METHOD or PART/METHOD, separated by commas, e.g. relief/palette,independent.",
)
@click.option(
    "--compare",
    "compare_with",
    type=FILE,
    help="Result of an earlier run to compare errors with [default: the kept one].",
)
@click.option("-q", "--quiet", is_flag=True, help="Say nothing while working.")
def bench(
    quick: bool,
    json_file: Path | None,
    folder: Path | None,
    seed: int | None,
    only: str,
    compare_with: Path | None,
    quiet: bool,
) -> None:
    """Measure error and speed of every method on scenes with a known truth, a reference beside them.

    Exits with 1 if an error is worse than in the result compared with, beyond scatter. Speeds are only told.
    """
    outputs = [json_file] if json_file else []
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        outputs += [folder / name for name in FILES]
    check_new(*outputs)
    from benchmarks.accuracy import run
    from benchmarks.accuracy.compare import compare, kept_result, read_report
    from benchmarks.accuracy.settings import settings

    # Before the run, which takes minutes.
    old_file = compare_with or kept_result(quick=quick)
    old = read_report(old_file) if compare_with or old_file.exists() else None
    chosen = run.selected(settings(quick=quick), only)
    seed = secrets.randbelow(MAX_SEED) if seed is None else seed
    click.echo(f"seed {seed}")
    with run_bar("bench", quiet=quiet) as (announce, track):
        report = run.bench(chosen, seed, announce, track) | {"quick": quick, "only": only}
    if json_file:
        write_json(json_file, report, read=read_report)
    if folder is not None:
        _write_folder(folder, report)
    click.echo(rows_table(report["rows"]))
    failed = [check["name"] for check in report["checks"] if not check["passed"]]
    for name in failed:
        click.echo(f"does not hold: {name}", err=True)
    comparison = compare(report, old) if old else None
    _tell(comparison, old_file)
    if failed or (comparison and comparison.regressions):
        sys.exit(1)


def _write_folder(folder: Path, report: dict[str, Any]) -> None:
    from benchmarks.accuracy.compare import read_report
    from benchmarks.accuracy.page import page
    from benchmarks.accuracy.pareto import write_pareto
    from instrument.files.whole_file import write_whole

    write_json(folder / "bench.json", report, read=read_report)
    write_pareto(folder / "bench.png", report)
    write_whole(folder / "accuracy.md", page(report))


def _tell(comparison: Comparison | None, old_file: Path) -> None:
    if comparison is None or comparison.n_rows == 0:
        click.echo(f"not compared: no row of {old_file.name} was run")
        return
    click.echo(f"{comparison.n_rows} rows compared with {old_file.name}: {len(comparison.regressions)} figures worse")
    for text in comparison.notes:
        click.echo(f"  {text}")
    for text in comparison.regressions:
        click.echo(f"  worse: {text}", err=True)


def rows_table(rows: list[dict[str, Any]]) -> str:
    """Return the rows as text."""
    head = ("part / method", "case", "views", "noise", "mean", "median", "95 %", "> 5 deg", "pixels/s", "x ref")
    return text_table([head, *(_cells(row) for row in rows)])


def _cells(row: dict[str, Any]) -> tuple[str, ...]:
    case = ", ".join(text for text in (row["table"], row["variant"], row["method_variant"]) if text)
    errors = (f"{row[key]:.3f}" for key in ("mean_deg", "median_deg", "p95_deg"))
    return (
        f"{row['part']} / {row['method']}",
        case,
        str(row["n_views"]),
        f"{100 * row['noise']:.1f} %",
        *errors,
        f"{100 * row['share_above_5deg']:.1f} %",
        f"{row['pixels_per_s']:.0f}",
        f"{row['ratio_to_reference']:.1f}",
    )
