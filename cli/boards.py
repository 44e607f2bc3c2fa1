"""`halfangle boards`: the marker boards, to be printed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click

from cli.output import FILE, FiniteRange, check_new

_PAPER = click.Choice(["auto", "a4", "a3", "letter"])
_AREA = "Without FILE: propose four boards around an area of this width and height."


@click.command(epilog="Example: halfangle boards --area-mm 60 60 -o boards.pdf")
@click.argument("file", type=FILE, required=False)
@click.option("-o", "--output", type=FILE, required=True, help="PDF to write.")
@click.option("--paper", type=_PAPER, default="auto", show_default=True, help="auto is a4, or a3 if a4 is too small.")
@click.option("--area-mm", type=FiniteRange(min=1.0), nargs=2, metavar="W H", help=_AREA)
def boards(file: Path | None, output: Path, paper: Any, area_mm: tuple[float, float] | None) -> None:
    """Draw the boards of FILE (rig.toml, capture.toml, or [[boards]] alone) at true size, to be printed.

    With --area-mm the tables of the proposed boards are written beside the PDF, to be copied into such a file.
    """
    if (file is None) == (area_mm is None):
        raise click.UsageError("give either FILE or --area-mm.")
    if output.suffix.lower() != ".pdf":
        raise click.UsageError(f"{output} is to be a PDF: give a name that ends in .pdf.")
    tables = output.with_suffix(".toml")
    check_new(output, *([tables] if area_mm else []))
    from analysis.camera.board_sheet import board_sheets
    from instrument.files.whole_file import write_whole
    from instrument.imports.proposed_boards import proposal_text
    from instrument.imports.stated_boards import boards_to_print

    stated = boards_to_print(file, area_mm)
    sheets = board_sheets(stated.boards, stated.area_mm, paper)
    write_whole(output, sheets.pdf())
    click.echo(f"{output}: {sheets.as_text()}")
    if area_mm is not None:
        write_whole(tables, proposal_text(area_mm, output.name))
        click.echo(f"{tables}: tables of the boards, to be copied into capture.toml or rig.toml")
