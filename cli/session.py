"""`halfangle session info`, `verify`, `list`, `quick-look`, `pack`, `export` and `documents`."""

from __future__ import annotations

import json
import sys
from pathlib import Path

import click

from cli.output import FINISHED_WITH_WARNINGS, PATH, check_new, json_option
from instrument.files.validation import LINE_BREAK, printable


@click.group()
def session() -> None:
    """Look at, verify, pack and export session files."""


@session.command(epilog="Example: halfangle session info relief.h5")
@click.argument("path", type=PATH)
@json_option
def info(path: Path, as_json: bool) -> None:
    """Say what the session PATH holds."""
    from instrument.session_tools.summary import summarise
    from instrument.session_tools.text import summary_text

    summary = summarise(path)
    click.echo(json.dumps(summary, indent=2) if as_json else summary_text(summary))


@session.command(epilog="Example: halfangle session verify relief.h5")
@click.argument("path", type=PATH)
@json_option
def verify(path: Path, as_json: bool) -> None:
    """Check the session PATH, every frame of it, and say which poses are good; PATH is never changed.

    Exit 1 if anything is wrong, 2 if it is no session.
    """
    from instrument.session_tools.examination import examination
    from instrument.session_tools.text import verdict_text

    found = examination(path)
    click.echo(json.dumps(found.as_dict()) if as_json else verdict_text(found))
    if found.problems:
        sys.exit(1)


@session.command("list", epilog="Example: halfangle session list captures")
@click.argument("folder", type=click.Path(path_type=Path, exists=True, file_okay=False), default=".")
@json_option
def list_sessions(folder: Path, as_json: bool) -> None:
    """List every HDF5 file (*.h5) in FOLDER (the current one by default) with its state.

    complete, interrupted, recording (being written now) or aborted; damaged, with the reason; other: no session.
    """
    from instrument.session_tools.summary import summarise_all
    from instrument.session_tools.text import listed_text

    rows = summarise_all(sorted(folder.glob("*.h5")))
    if as_json:
        click.echo(json.dumps(rows, indent=2))
        return
    for row in rows:
        click.echo(printable(listed_text(row)))


@session.command("quick-look", epilog="Example: halfangle session quick-look relief.h5 -o relief.png")
@click.argument("path", type=PATH)
@click.option("-o", "--output", type=PATH, help="Picture to write (PNG).")
@json_option
def quick_look(path: Path, output: Path | None, as_json: bool) -> None:
    """Estimate normals of the session PATH from its previews and the rig file, and say where more poses would help.

    PATH may be interrupted, or being captured. Exit 3 if its poses do not determine normals yet.
    """
    from analysis.quick_look.figure import write_quick_figure
    from analysis.quick_look.quick_look import quick_look as quick_look_of
    from analysis.quick_look.text import quick_look_lines
    from instrument.files.probe import refuse_dangerous
    from instrument.session.session import Session
    from protocols.planning.next_pose import next_pose
    from protocols.planning.session_rig import planned_poses_of

    if output is not None:
        check_new(output)
    refuse_dangerous(path)
    with Session(path) as source:
        planned = planned_poses_of(source)
    look = quick_look_of(planned.views, planned.previews)
    best = next_pose(planned, look.used)
    if output is not None:
        write_quick_figure(output, look, path)
    if as_json:
        figures = {"session": str(path), "n_poses": planned.n_poses, **look.as_dict()}
        click.echo(json.dumps({**figures, "next_pose": None if best is None else best.as_dict()}, indent=2))
    else:
        lines = [f"{path}: {len(look.used)} of {planned.n_poses} poses", *quick_look_lines(look)]
        lines += [] if best is None else [f"  next       {best.as_text()}"]
        # Names of axes come from the session, whoever made it.
        click.echo(printable("\n".join(lines), keep=LINE_BREAK))
    if look.problems:
        sys.exit(FINISHED_WITH_WARNINGS)


@session.command(epilog="Example: halfangle session pack relief.h5 -o relief.packed.h5")
@click.argument("path", type=PATH)
@click.option("-o", "--output", required=True, type=PATH, help="The smaller session to write.")
def pack(path: Path, output: Path) -> None:
    """Copy the session PATH into a smaller file of the same content, and verify that; PATH is not changed."""
    from cli.progress import progress_bar
    from instrument.session_tools.pack import pack_session

    check_new(output)
    with progress_bar("pack") as step:
        pack_session(path, output, lambda done, total, name: step(done, name, total))
    before, after = (file.stat().st_size for file in (path, output))
    click.echo(f"{output}: {after / 1e6:.2f} MB of {before / 1e6:.2f} MB, {100 * after / before:.0f} %")


@session.command(epilog="Example: halfangle session export relief.h5 -o relief")
@click.argument("path", type=PATH)
@click.option("-o", "--output", required=True, type=PATH, help="Folder to make.")
def export(path: Path, output: Path) -> None:
    """Write the frames of the session PATH as DNG files with a capture.toml; `halfangle import` reads them back."""
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
@click.argument("path", type=PATH)
@click.option("-o", "--output", required=True, type=PATH, help="File to write, JSON lines.")
def write_documents(path: Path, output: Path) -> None:
    """Write the session PATH as documents of the event model, a name and a document a line; the frames stay in PATH."""
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
