"""`halfangle bench`: accuracy and speed on simulated scenes."""

from __future__ import annotations

import secrets
import sys
from pathlib import Path
from typing import NoReturn

import click

from cli.output import FILE, FOLDER, check_new, quiet_option
from cli.progress import run_bar
from instrument.files.json_file import write_json

MAX_SEED = 2**32 - 1


@click.command(epilog="Example: halfangle bench --quick -o out")
@click.option("--quick", is_flag=True, help="Two minutes instead of half an hour: fewer settings, smaller scenes.")
@click.option("--json", "json_file", type=FILE, help="Write the rows here.")
@click.option("-o", "--output", "folder", type=FOLDER, help="Folder for rows, picture and page; for --real, pictures.")
@click.option("--real", is_flag=True, help="Instead: captures and materials that nobody here made.")
@click.option("--seed", type=click.IntRange(0, MAX_SEED), help="Of the scenes [default: a fresh one].")
@click.option("--only", default="", metavar="ROWS", help="Rows to run: PART, METHOD or PART/METHOD, comma-separated.")
@click.option("--compare", "compare_with", type=FILE, help="Earlier result to compare with [default: the kept one].")
@quiet_option
def bench(
    quick: bool, json_file: Path | None, folder: Path | None, real: bool, seed: int | None, only: str,
    compare_with: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """Measure error and speed of every method on scenes with a known truth, a reference beside them.

    Exits with 1 if an error is worse than in the result compared with, beyond scatter. Speeds are only told.
    """
    from benchmarks.accuracy.folder import FILES, write_report

    outputs = [json_file] if json_file else []
    if folder is not None:
        folder.mkdir(parents=True, exist_ok=True)
        outputs += [folder / name for name in FILES]
    check_new(*outputs)
    from benchmarks.accuracy import run
    from benchmarks.accuracy.compare import compare, kept_result, read_report
    from benchmarks.accuracy.settings import settings
    from benchmarks.accuracy.text import comparison_text, rows_table

    seed = secrets.randbelow(MAX_SEED) if seed is None else seed
    if real:
        _bench_real(seed, json_file, folder, quiet=quiet)
    # Before the run, which takes minutes.
    old_file = compare_with or kept_result(quick=quick)
    old = read_report(old_file) if compare_with or old_file.exists() else None
    chosen = run.selected(settings(quick=quick), only)
    click.echo(f"seed {seed}")
    with run_bar("bench", quiet=quiet) as (announce, track):
        report = run.bench(chosen, seed, announce, track) | {"quick": quick, "only": only}
    if json_file:
        write_json(json_file, report, read=read_report)
    if folder is not None:
        write_report(folder, report)
    click.echo(rows_table(report["rows"]))
    failed = [check["name"] for check in report["checks"] if not check["passed"]]
    for name in failed:
        click.echo(f"does not hold: {name}", err=True)
    comparison = compare(report, old) if old else None
    click.echo(comparison_text(comparison, old_file.name))
    for text in comparison.regressions if comparison else ():
        click.echo(f"  worse: {text}", err=True)
    if failed or (comparison and comparison.regressions):
        sys.exit(1)


def _bench_real(seed: int, json_file: Path | None, folder: Path | None, *, quiet: bool) -> NoReturn:
    from benchmarks.real.run import run, shortfalls
    from benchmarks.real.text import keep, rows_table

    with run_bar(f"bench --real, seed {seed}", quiet=quiet) as (announce, _):
        rows = list(run(seed, announce, folder))
    if json_file:
        keep(rows, seed, json_file)
    click.echo(rows_table(rows))
    for text in shortfalls(rows):
        click.echo(f"does not hold: {text}", err=True)
    sys.exit(1 if shortfalls(rows) else 0)
