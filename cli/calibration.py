"""`halfangle boards` and `calibrate`: boards to print; from a session to a registered stack, with a report."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cli.output import FILE, FINISHED_WITH_WARNINGS, FiniteRange, check_new, quiet_option
from cli.progress import stage_bars
from instrument.files.json_file import write_json

if TYPE_CHECKING:
    from analysis.pipeline import Calibrated


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
    from instrument.config.proposed_boards import proposal_text
    from instrument.config.stated_boards import boards_to_print
    from instrument.files.whole_file import write_whole

    stated = boards_to_print(file, area_mm)
    sheets = board_sheets(stated.boards, stated.area_mm, paper)
    write_whole(output, sheets.pdf())
    click.echo(f"{output}: {sheets.as_text()}")
    if area_mm is not None:
        write_whole(tables, proposal_text(area_mm, output.name))
        click.echo(f"{tables}: tables of the boards, to be copied into capture.toml or rig.toml")


@click.command(epilog="Example: halfangle calibrate session.h5 -o area.stack.h5 --report calibration.html")
@click.argument("session", type=FILE)
@click.option("-o", "--output", type=FILE, help="Registered stack to write; without it the calibration is told only.")
@click.option("--pitch", type=FiniteRange(min=0.001), help="Pixel of the stack, mm [default: as fine as the pictures].")
@click.option("--report", "page", type=FILE, help="HTML page of checks, pictures and parameters to write.")
@click.option("--json", "json_file", type=FILE, help="Write figures and checks here too.")
@quiet_option
def calibrate(
    session: Path, output: Path | None, pitch: float | None, page: Path | None, json_file: Path | None, quiet: bool
) -> None:
    """Calibrate a SESSION from its own pictures, judge that, and register it onto the sample plane.

    Exits with 3 if a check ends with FAIL: the files are written, and are not to be trusted.
    """
    check_new(*(path for path in (output, page, json_file) if path))
    from analysis.pipeline import calibrate as run
    from analysis.pipeline import check_calibration
    from analysis.reporting.calibration_file import read_calibration
    from analysis.reporting.calibration_report import write_calibration_page
    from analysis.reporting.checks import Status, count
    from analysis.reporting.text import budget_text, checks_text

    with stage_bars(quiet=quiet) as stages:
        if output is None:
            report = check_calibration(session, stages=stages)
        else:
            calibrated = run(session, output, pitch=pitch, stages=stages)
            report = calibrated.report
    if page:
        write_calibration_page(page, report, f"Calibration of {session.name}")
    if json_file:
        write_json(json_file, report.as_dict(), read=read_calibration)
    if output:
        click.echo(f"{output}: {_stack_text(calibrated)}")
    if report.budget is not None:
        click.echo(budget_text(report.budget.contributions))
    click.echo(checks_text(report, all_checks=not (output or page or json_file)))
    if count(report.checks, Status.FAIL):
        sys.exit(FINISHED_WITH_WARNINGS)


def _stack_text(calibrated: Calibrated) -> str:
    stack, figures = calibrated.stack, calibrated.report.figures
    return (
        f"{stack.n_views} views of {stack.grid.width} x {stack.grid.height} pixels of {stack.pixel_pitch:g} mm; "
        f"corners {figures['corner_rms_px']:.3f} px RMS, white {100 * figures['white_rms']:.2f} % RMS"
    )
