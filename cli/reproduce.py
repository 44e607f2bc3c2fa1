"""`halfangle reproduce`: the paper's experiments."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Any

import click

from cli.output import FILE, FOLDER, quiet_option

SUMMARY = ("name", "status", "ours", "stated", "verdict", "why", "seconds")


@click.command(epilog="Example: halfangle reproduce slices baseline --quick -o reproduction")
@click.argument("names", nargs=-1, metavar="[NAME]...")
@click.option(
    "--merl", type=click.Path(path_type=Path, exists=True, file_okay=False), help="Folder of MERL's .binary files."
)
@click.option(
    "--quick", is_flag=True, help="Ten minutes instead of up to three hours: fewer materials, smaller scenes."
)
@click.option("--seed", type=click.IntRange(0, 2**32 - 1), default=2017, show_default=True, help="Of what is random.")
@click.option(
    "-o", "--output", "folder", type=FOLDER, default="reproduction", help="A later run goes on in this folder."
)
@click.option("--json", "json_file", type=FILE, help="Write a summary here.")
@click.option("--page", type=FILE, help="Write the page here too, with its pictures.")
@quiet_option
def reproduce(
    names: tuple[str, ...], merl: Path | None, quick: bool, seed: int, folder: Path, json_file: Path | None,
    page: Path | None, quiet: bool,
) -> None:  # fmt: skip
    """Run the experiments of the paper's supplement, all or those named, and hold ours against what it states.

    What was run before in the same way is not run again. Exit 1 if an experiment failed, 3 if one was skipped.
    """
    from benchmarks.reproduction import reproduce as reproduction
    from benchmarks.reproduction.page import write_page
    from cli.progress import run_bar
    from instrument.files.json_file import write_json

    reproduction.check_names(names)
    folder.mkdir(parents=True, exist_ok=True)
    click.echo(f"seed {seed}")
    results = []
    with run_bar("reproduce", quiet=quiet) as (announce, track):
        for result in reproduction.reproduce(
            names or reproduction.NAMES, folder, quick=quick, seed=seed, merl=merl, announce=announce, track=track
        ):
            results.append(result)
            click.echo(_line(result))
    summary = {"quick": quick, "seed": seed, "experiments": [{key: r.get(key) for key in SUMMARY} for r in results]}
    write_json(folder / "reproduction.json", summary, overwrite=True)
    if json_file is not None:
        write_json(json_file, summary, overwrite=True)
    for target in (folder / "reproduction.md", page):
        if target is not None:
            write_page(target, folder, results, summary)
    statuses = {result["status"] for result in results}
    if "failed" in statuses:
        sys.exit(1)
    if "skipped" in statuses:
        sys.exit(3)


def _line(result: dict[str, Any]) -> str:
    told = result["ours"] if result["status"] == "ok" else result["why"]
    return f"{result['name']:<16} {result['verdict'] or result['status']:<14} {told} ({result['seconds']:.0f} s)"
