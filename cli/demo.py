"""`halfangle demo`: the whole chain on the simulated rig, scored against what the simulation knows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import click

from cli.output import FOLDER, check_new, json_file_option, quiet_option
from cli.progress import stage_bars
from instrument.files.json_file import write_json

if TYPE_CHECKING:
    from analysis.stages import Stages
    from instrument.config.rig import RigConfig

FILES = ("session.h5", "area.stack.h5", "result.h5", "report.html", "calibration.html")
PITCH_MM, QUICK_PITCH_MM = 0.25, 0.5


@click.command(epilog="Example: halfangle demo -o out")
@click.option("-o", "--output", "folder", type=FOLDER, default="demo", show_default=True, help="Folder for all files.")
@json_file_option
@click.option("--quick", is_flag=True, help="Fewer poses and larger pixels: a third of the time, a coarser result.")
@click.option("--force", is_flag=True, help="Replace the files of an earlier demo.")
@quiet_option
def demo(folder: Path, json_file: Path | None, quick: bool, force: bool, quiet: bool) -> None:
    """Capture, calibrate, reconstruct and report a sample on the simulated rig, and compare with the truth."""
    session, stack_file, result_file, page, calibration_page = files = [folder / name for name in FILES]
    written = [*files, *([json_file] if json_file else [])]
    if force:
        for path in written:
            path.unlink(missing_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    check_new(*written)
    from analysis.pipeline import calibrate, reconstruct, report
    from analysis.registration.stack_file import write_truth
    from analysis.reporting.calibration_report import write_calibration_page
    from analysis.reporting.text import checks_text, stages_text, summary_text
    from analysis.results.result_file import write_result
    from benchmarks.common.simulated import EXAMPLES, truth_of
    from instrument.config.loading import load_rig

    rig = load_rig(EXAMPLES / "simulated.toml")
    with stage_bars(quiet=quiet) as stages:
        _capture(rig, session, stages, quick=quick)
        calibrated = calibrate(session, stack_file, pitch=QUICK_PITCH_MM if quick else PITCH_MM, stages=stages)
        write_truth(stack_file, truth_of(rig, calibrated.stack.grid))
        result = reconstruct(stack_file, calibration=calibrated.report, stages=stages)
    write_calibration_page(calibration_page, calibrated.report, "halfangle demo: the calibration of the simulated rig")
    write_result(result_file, result)
    report(result, page, "halfangle demo: a simulated relief of five materials")
    if json_file:
        write_json(json_file, result.figures())
    click.echo(f"{summary_text(result.summary)}\n\n{stages_text(stages)}\n")
    click.echo(checks_text(calibrated.report))
    click.echo("wrote " + ", ".join(map(str, files)))


def _capture(rig: RigConfig, session: Path, stages: Stages, *, quick: bool) -> None:
    from benchmarks.common.simulated import EXAMPLES
    from instrument.config.loading import load_protocol
    from protocols.capture.engine import capture

    protocol = load_protocol(EXAMPLES / ("quick_sweep.toml" if quick else "hdr_sweep.toml"))
    with stages.measure("capture"):
        capture(rig, protocol, session)
