"""`halfangle session info`, `verify`, `list`, `quick-look`, `pack`, `export` and `documents`."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from instrument.files.validation import printable

if TYPE_CHECKING:
    from instrument.session_tools.examination import Examination

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")


@click.group()
def session() -> None:
    """Look at, verify, pack and export session files."""


@session.command(epilog="Example: halfangle session info relief.h5")
@click.argument("path", type=click.Path(path_type=Path))
@json_option
def info(path: Path, as_json: bool) -> None:
    """Say what the session PATH holds."""
    from instrument.session_tools.summary import summarise

    summary = summarise(path)
    click.echo(json.dumps(summary, indent=2) if as_json else _table(summary))


@session.command(epilog="Example: halfangle session verify relief.h5")
@click.argument("path", type=click.Path(path_type=Path))
@json_option
def verify(path: Path, as_json: bool) -> None:
    """Check the session PATH, every frame of it, and say which poses are good; PATH is never changed.

    Exit 1 if anything is wrong, 2 if it is no session.
    """
    from instrument.session_tools.examination import examination

    found = examination(path)
    click.echo(json.dumps(found.as_dict()) if as_json else _verdict(found))
    if found.problems:
        sys.exit(1)


def _verdict(found: Examination) -> str:
    lines = [str(problem) for problem in found.problems]
    passed = "" if found.problems else "every check passed; "
    lines.append(f"{found.path}: {passed}{len(found.good)} of {found.n_poses} poses are good: {_ranges(found.good)}")
    if found.missing:
        lines.append(f"not captured: poses {_ranges(found.missing)}; halfangle resume goes on with them")
    if found.problems:
        lines.append("Reprocess the good poses only; keep the file as it is, and capture the others again.")
    return "\n".join(lines)


def _ranges(numbers: list[int]) -> str:
    """Return [0, 1, 2, 5] as "0-2, 5"."""
    starts = [n for n in numbers if n - 1 not in numbers]
    ends = [n for n in numbers if n + 1 not in numbers]
    return ", ".join(f"{a}-{b}" if a < b else str(a) for a, b in zip(starts, ends, strict=True)) or "none"


@session.command("list", epilog="Example: halfangle session list captures")
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False), default=".")
@json_option
def list_sessions(folder: Path, as_json: bool) -> None:
    """List every HDF5 file (*.h5) in FOLDER (the current one by default) with its state.

    complete, interrupted, recording (being written now) or aborted; damaged, with the reason; other: no session.
    """
    from instrument.session_tools.summary import summarise_all

    rows = summarise_all(sorted(folder.glob("*.h5")))
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    for row in rows:
        click.echo(printable(_listed(row)))


def _listed(row: dict[str, Any]) -> str:
    if "problems" in row:
        (where, what), *others = row["problems"]
        place = "" if where == row["path"] else f"{where}: "
        poses, text = "", place + what + (f" (and {len(others)} more)" if others else "")
    else:
        poses, text = f"{row['n_complete']:>5}/{row['n_poses']:<5}", row["title"]
    return f"{row['state']:<12} {poses:<11} {row['path']}  {text}"


@session.command("quick-look", epilog="Example: halfangle session quick-look relief.h5 -o relief.png")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("-o", "--output", type=click.Path(path_type=Path), help="Picture to write (PNG).")
@json_option
def quick_look(path: Path, output: Path | None, as_json: bool) -> None:
    """Estimate normals of the session PATH from its previews and the rig file, and say where more poses would help.

    PATH may be interrupted, or being captured. Exit 3 if its poses do not determine normals yet.
    """
    from cli.output import check_new
    from cli.quick_look import look_at, quick_text, write_picture

    if output is not None:
        check_new(output)
    found = look_at(path)
    if output is not None:
        write_picture(found, output)
    click.echo(json.dumps(found.as_dict(), indent=2) if as_json else quick_text(found))
    if found.look.problems:
        sys.exit(3)


@session.command(epilog="Example: halfangle session pack relief.h5 -o relief.packed.h5")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="The smaller session to write.")
def pack(path: Path, output: Path) -> None:
    """Copy the session PATH into a smaller file of the same content, and verify that; PATH is not changed."""
    from cli.output import check_new
    from cli.progress import progress_bar
    from instrument.session_tools.pack import pack_session

    check_new(output)
    with progress_bar("pack") as step:
        pack_session(path, output, lambda done, total, name: step(done, name, total))
    before, after = (file.stat().st_size for file in (path, output))
    click.echo(f"{output}: {after / 1e6:.2f} MB of {before / 1e6:.2f} MB, {100 * after / before:.0f} %")


@session.command(epilog="Example: halfangle session export relief.h5 -o relief")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="Folder to make.")
def export(path: Path, output: Path) -> None:
    """Write the frames of the session PATH as DNG files with a capture.toml; `halfangle import` reads them back."""
    from cli.output import check_new
    from cli.progress import progress_bar
    from instrument.files.probe import refuse_dangerous
    from instrument.imports.export import export_session
    from instrument.session.session import Session

    check_new(output)
    refuse_dangerous(path)
    with Session(path) as source, progress_bar("export") as step:
        n_written = export_session(source, output, lambda done, total, name: step(done, name, total))
    click.echo(f"{output}: {n_written} pictures and capture.toml")


@session.command("documents", epilog="Example: halfangle session documents relief.h5 -o relief.jsonl")
@click.argument("path", type=click.Path(path_type=Path))
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="File to write, JSON lines.")
def write_documents(path: Path, output: Path) -> None:
    """Write the session PATH as documents of the event model, a name and a document a line; the frames stay in PATH."""
    from cli.output import check_new
    from instrument.files.probe import refuse_dangerous
    from instrument.files.whole_file import write_whole
    from instrument.session.session import Session
    from instrument.session_tools.documents import as_line, documents

    check_new(output)
    refuse_dangerous(path)
    with Session(path) as source:
        lines = [as_line(name, document) for name, document in documents(source)]
    write_whole(output, "".join(f"{line}\n" for line in lines))
    click.echo(f"{output}: {len(lines)} documents")


def _table(summary: dict[str, Any]) -> str:
    width = max(map(len, summary))
    return "\n".join(f"{name:<{width}}  {printable(_shown(value))}" for name, value in summary.items())


def _shown(value: Any) -> str:
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
