"""`halfangle calibrate`: from a session to a registered stack, with a report of how good the calibration is."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from cli.output import check_new, stage_announcer, write_json
from instrument.files.validation import LINE_BREAK, printable

if TYPE_CHECKING:
    from analysis.registration.stack import Stack
    from analysis.reporting.calibration_report import CalibrationReport
    from analysis.stages import Stages

FILE = click.Path(path_type=Path, dir_okay=False)


@click.command(epilog="Example: halfangle calibrate session.h5 -o area.stack.h5 --report calibration.html")
@click.argument("session", type=FILE)
@click.option("-o", "--output", type=FILE, help="Registered stack to write; without it the calibration is told only.")
@click.option(
    "--pitch",
    type=click.FloatRange(min=0.001),
    help="Size of a pixel of the stack, mm [default: as fine as the pictures].",
)
@click.option("--report", "page", type=FILE, help="HTML page of checks, pictures and parameters to write.")
@click.option("--json", "json_file", type=FILE, help="Write figures and checks here too.")
@click.option("-q", "--quiet", is_flag=True, help="Say nothing while working.")
def calibrate(
    session: Path, output: Path | None, pitch: float | None, page: Path | None, json_file: Path | None, quiet: bool
) -> None:
    """Calibrate a SESSION from its own pictures, judge that, and register it onto the sample plane."""
    check_new(*(path for path in (output, page, json_file) if path))
    from analysis.reporting.calibration_report import write_calibration_page
    from analysis.stages import Stages
    from instrument.files.probe import refuse_dangerous

    refuse_dangerous(session)
    stages = Stages(stage_announcer(quiet))
    report = calibration_only(session, stages) if output is None else calibrate_into(session, output, pitch, stages)
    if page:
        write_calibration_page(page, report, f"Calibration of {session.name}")
    if json_file:
        write_json(json_file, report.as_dict())
    if output:
        _tell_stack(output, report)
    click.echo(checks_text(report, tell_all=not (output or page or json_file)))


def calibration_only(session: Path, stages: Stages) -> CalibrationReport:
    """Calibrate a session as far as it goes, and judge it."""
    from analysis.calibration.session import calibrate_session
    from analysis.radiometry.frames import MergedFrames
    from analysis.reporting.calibration_report import report_of
    from instrument.session.session import Session

    with Session(session) as opened:
        return report_of(opened, calibrate_session(opened, MergedFrames(opened), stages))


def calibrate_into(session: Path, output: Path, pitch: float | None, stages: Stages) -> CalibrationReport:
    """Register a session into the new file `output`, and judge the calibration."""
    from analysis.calibration.register import register
    from analysis.reconstruction.error_budget import budget_of
    from analysis.registration.stack_file import read_stack
    from analysis.reporting.calibration_report import report_of
    from instrument.session.session import Session

    with Session(session) as opened:
        calibration = register(opened, output, pitch, stages)
        with stages.measure("error budget"):
            budget = budget_of(read_stack(output))
        return report_of(opened, calibration, budget)


def stack_from_session(
    session: Path, output: Path, pitch: float | None, stages: Stages
) -> tuple[Stack, CalibrationReport]:
    """Register a session into the file `output`; return the stack and the report of its calibration."""
    from analysis.registration.stack_file import read_stack

    report = calibrate_into(session, output, pitch, stages)
    return read_stack(output), report


def checks_text(report: CalibrationReport, *, tell_all: bool = False) -> str:
    """Return the checks that did not pass, or all, the worst first, and how many there are of each kind."""
    from analysis.reporting.checks import Status, by_severity, count

    checks = by_severity(report.checks)
    lines = [
        f"{check.status.value}  {check.name}: {check.number} (allowed: {check.threshold}). Next: {check.remedy}"
        for check in checks
        if check.status is not Status.PASS
    ]
    if tell_all:
        lines += [f"PASS  {check.name}: {check.number}" for check in checks if check.status is Status.PASS]
    lines.append(f"calibration checks: {report.verdict}")
    if count(checks, Status.FAIL):
        lines.append("THE CALIBRATION FAILED: do not trust maps made with it before what failed is put right.")
    # Names and numbers come from the session, whoever made it.
    return printable("\n".join(lines), keep=LINE_BREAK)


def budget_text(contributions: dict[str, float]) -> str:
    """Return what each source adds to the normals, the largest first."""
    ordered = sorted(contributions.items(), key=lambda item: -item[1])
    each = ", ".join(f"{name} {deg:.3f}" for name, deg in ordered)
    return f"errors of the normals, deg per axis: {each}; {ordered[0][0]} dominates"


def _tell_stack(output: Path, report: CalibrationReport) -> None:
    from analysis.registration.stack_file import read_stack

    stack, figures = read_stack(output), report.figures
    click.echo(
        f"{output}: {stack.n_views} views of {stack.grid.width} x {stack.grid.height} pixels "
        f"of {stack.pixel_pitch:g} mm; "
        f"corners {figures['corner_rms_px']:.3f} px RMS, white {100 * figures['white_rms']:.2f} % RMS"
    )
    if report.budget is not None:
        click.echo(budget_text(report.budget.contributions))
