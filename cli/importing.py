"""`halfangle import`: pictures from elsewhere."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import click

from cli.output import FILE, PATH, FiniteRange, check_new

EPILOG = """Examples:

\b
halfangle import --init leaf
halfangle import leaf -o leaf.h5
halfangle import --registered card --positions positions.csv --width-mm 68.48 --gamma 2.2 -o card.stack.h5
"""


@click.command("import", epilog=EPILOG)
@click.argument("folder", type=PATH)
@click.option("-o", "--output", type=FILE, help="Session (or registered stack) to write; FOLDER.h5 by default.")
@click.option("--capture", "capture_file", type=FILE, help="What pictures do not say; FOLDER/capture.toml by default.")
@click.option("--init", is_flag=True, help="Write FOLDER/capture.toml, filled in as far as the pictures tell.")
@click.option("--registered", is_flag=True, help="The pictures are registered to the sample plane: make a stack.")
@click.option("--positions", type=FILE, help="With --registered: CSV of camera (and light) a picture; also in FOLDER.")
@click.option("--width-mm", type=FiniteRange(min=0.001), help="With --registered: width of the area in the pictures.")
@click.option("--gamma", type=FiniteRange(0.1, 5.0), help="With --registered: display gamma; 1 if they are linear.")
@click.option("--bin", "binning", type=click.IntRange(1), help="With --registered: average squares of so many pixels.")
def import_pictures(
    folder: Path,
    output: Path | None,
    capture_file: Path | None,
    init: bool,
    registered: bool,
    positions: Path | None,
    width_mm: float | None,
    gamma: float | None,
    binning: int | None,
) -> None:
    """Make a session of the pictures in FOLDER: RAW, TIFF, PNG, JPEG, HEIC, BMP, EXR, HDR, PFM or NumPy.

    FOLDER/capture.toml says what the pictures do not; --init writes one to complete. Without it FOLDER/views are the
    views, FOLDER/darks and FOLDER/flats what they are called.
    """
    if not folder.is_dir():
        from instrument.pictures.reading import why_no_folder

        raise click.UsageError(f"{folder} {why_no_folder(folder)}.")
    given = {"--positions": positions, "--width-mm": width_mm, "--gamma": gamma, "--bin": binning}
    if registered:
        _refuse("cannot go with --registered", {"--init": init, "--capture": capture_file})
        if positions is None or width_mm is None or output is None:
            raise click.UsageError("--registered needs --positions, --width-mm, --output too.")
        _import_registered(folder, positions, width_mm, gamma, binning or 1, output)
        return
    _refuse("is for --registered only; for a session use capture.toml", given)
    if init:
        _refuse("cannot go with --init", {"--output": output, "--capture": capture_file})
        _write_template(folder)
    else:
        _import_session(folder, capture_file, output or Path(f"{folder.resolve().name}.h5"))


def _import_registered(
    folder: Path, positions: Path, width_mm: float, gamma: float | None, binning: int, output: Path
) -> None:
    check_new(output)
    from analysis.registration.registered_pictures import import_registered
    from analysis.registration.stack_file import write_stack

    found = positions if positions.exists() else folder / positions
    stack = import_registered(folder, found, width_mm, gamma, binning)
    write_stack(output, stack)
    height, width = stack.grid.height, stack.grid.width
    click.echo(f"{output}: {stack.n_views} views of {width} x {height} pixels of {stack.pixel_pitch:.4g} mm")


def _import_session(folder: Path, capture_file: Path | None, output: Path) -> None:
    check_new(output)
    from cli.progress import progress_bar
    from instrument.imports.prepare import import_facts, prepare_import
    from instrument.imports.writing import write_import

    with progress_bar("look") as step:
        prepared = prepare_import(folder, capture_file, lambda done, total, name: step(done, name, total))
    with progress_bar("import") as step:
        write_import(prepared, output, lambda done, total, name: step(done, name, total))
    click.echo("\n".join(f"{name:<17} {value}" for name, value in import_facts(prepared)))
    for note in prepared.sensor.notes:
        click.echo(f"note: {note}")
    click.echo(f"{output}: {len(prepared.arrangement.poses)} poses")


def _write_template(folder: Path) -> None:
    from instrument.files.whole_file import write_whole
    from instrument.imports.prepare import CAPTURE_FILE
    from instrument.imports.template import capture_template

    path = folder / CAPTURE_FILE
    check_new(path)
    write_whole(path, capture_template(folder))
    click.echo(f"{path}: complete it, then run: halfangle import {folder}")


def _refuse(why: str, options: Mapping[str, object]) -> None:
    if given := [name for name, value in options.items() if value]:
        raise click.UsageError(f"{', '.join(given)} {why}.")
