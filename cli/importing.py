"""`halfangle import`: pictures from elsewhere."""

from __future__ import annotations

from pathlib import Path

import click

from cli.output import check_new


@click.command(
    "import",
    epilog="Example: halfangle import --registered card --positions positions.csv --width-mm 68.48 --gamma 2.2 "
    "-o card.stack.h5",
)
@click.argument("folder", type=click.Path(path_type=Path, file_okay=False))
@click.option(
    "--registered", is_flag=True, required=True, help="The pictures are already registered to the sample plane."
)
@click.option(
    "--positions",
    type=click.Path(path_type=Path, dir_okay=False),
    required=True,
    help="CSV of the camera's (and light's) position per picture; looked for in FOLDER too.",
)
@click.option(
    "--width-mm", type=click.FloatRange(min=0.001), required=True, help="Width of the area that a picture shows."
)
@click.option(
    "--gamma", type=click.FloatRange(min=0.1, max=5.0), help="Display gamma of the pictures; 1 if they are linear."
)
@click.option(
    "--bin",
    "binning",
    type=click.IntRange(min=1),
    default=1,
    show_default=True,
    help="Average squares of so many pixels a side.",
)
@click.option(
    "-o", "--output", type=click.Path(path_type=Path, dir_okay=False), required=True, help="Registered stack to write."
)
def import_pictures(
    folder: Path, registered: bool, positions: Path, width_mm: float, gamma: float | None, binning: int, output: Path
) -> None:
    """Make a registered stack of the pictures in FOLDER."""
    assert registered, "click requires the flag"
    check_new(output)
    from analysis.importing import import_registered
    from analysis.stack_file import write_stack

    table = positions if positions.exists() else folder / positions
    stack = import_registered(folder, table, width_mm, gamma, binning)
    write_stack(output, stack)
    height, width = stack.grid.height, stack.grid.width
    click.echo(f"{output}: {stack.n_views} views of {width} x {height} pixels of {stack.pixel_pitch:.4g} mm")
