"""`halfangle session info`, `verify`, `list` and `export`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import click

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


@click.group()
def session() -> None:
    """Look at, verify and export session files."""


@session.command(epilog="Example: halfangle session info relief.h5")
@click.argument("path", type=click.Path(path_type=Path))
@json_option
def info(path: Path, as_json: bool) -> None:
    """Say what the session PATH holds."""
    from instrument.summary import summarise

    summary = summarise(path)
    click.echo(json.dumps(summary, indent=2) if as_json else _table(summary))


@session.command(epilog="Example: halfangle session verify relief.h5")
@click.argument("path", type=click.Path(path_type=Path))
@json_option
def verify(path: Path, as_json: bool) -> None:
    """Check the session PATH, every frame of it; exit 1 if anything is wrong, 2 if it is no session."""
    from instrument.verify import verify_session

    problems = list(verify_session(path))
    if as_json:
        click.echo(json.dumps([{"where": problem.where, "what": problem.what} for problem in problems]))
    else:
        click.echo("\n".join(map(str, problems)) or f"{path}: every check passed")
    if problems:
        sys.exit(1)


@session.command("list", epilog="Example: halfangle session list captures")
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False), default=".")
@json_option
def list_sessions(folder: Path, as_json: bool) -> None:
    """List the sessions in FOLDER (the current one by default)."""
    from instrument.summary import summarise_all

    rows = summarise_all(folder)
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    for row in rows:
        click.echo(f"{row['status']:<12} {row['n_complete']:>5}/{row['n_poses']:<5} {row['path']}  {row['title']}")


@session.command(epilog="Example: halfangle session export relief.h5 -o relief")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Folder to make.")
def export(path: Path, output: Path) -> None:
    """Write the frames of the session PATH as DNG files with a capture.toml; `halfangle import` reads them back."""
    from cli.output import check_new
    from cli.progress import progress_bar
    from instrument.pictures.export import export_session
    from instrument.session import Session

    check_new(output)
    with Session(path) as source, progress_bar("export") as step:
        n_written = export_session(source, output, lambda done, total, name: step(done, name, total))
    click.echo(f"{output}: {n_written} pictures and capture.toml")


def _table(summary: dict[str, Any]) -> str:
    width = max(map(len, summary))
    return "\n".join(f"{name:<{width}}  {_shown(value)}" for name, value in summary.items())


def _shown(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
