"""`halfangle demo`: the whole chain on the simulated rig, scored against what the simulation knows."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cli.calibration import checks_text, stack_from_session
from cli.output import check_new, stage_announcer, table, write_json
from cli.reconstruction import figures_table, result_from_stack

if TYPE_CHECKING:
    from analysis.stages import Stages
    from instrument.config.rig import RigConfig

FILES = ("session.h5", "area.stack.h5", "result.h5", "report.html", "calibration.html")
PITCH_MM, QUICK_PITCH_MM = 0.25, 0.5


@click.command(epilog="Example: halfangle demo -o out")
@click.option(
    "-o",
    "--output",
    "folder",
    type=click.Path(path_type=Path, file_okay=False),
    default=Path("demo"),
    show_default=True,
    help="Folder for the session, the stack, the result and the reports.",
)
@click.option(
    "--json", "json_file", type=click.Path(path_type=Path, dir_okay=False), help="Write the figures here too."
)
@click.option("--quick", is_flag=True, help="Fewer poses and larger pixels: a third of the time, a coarser result.")
@click.option("--force", is_flag=True, help="Replace the files of an earlier demo.")
@click.option("-q", "--quiet", is_flag=True, help="Say nothing while working.")
def demo(folder: Path, json_file: Path | None, quick: bool, force: bool, quiet: bool) -> None:
    """Capture, calibrate, reconstruct and report a sample on the simulated rig, and compare with the truth."""
    session, stack_file, result_file, page, calibration_page = files = [folder / name for name in FILES]
    written = [*files, *([json_file] if json_file else [])]
    if force:
        for path in written:
            path.unlink(missing_ok=True)
    folder.mkdir(parents=True, exist_ok=True)
    check_new(*written)
    from analysis.reconstruction.reconstruction import Options
    from analysis.registration.stack_file import read_stack, write_truth
    from analysis.reporting.calibration_report import write_calibration_page
    from analysis.reporting.result_report import write_report
    from analysis.results.result_file import write_result
    from analysis.stages import Stages
    from benchmarks.common.simulated import EXAMPLES, truth_of
    from instrument.config.loading import load_rig

    rig = load_rig(EXAMPLES / "simulated.toml")
    stages = Stages(stage_announcer(quiet))
    _capture(rig, session, stages, quick=quick)
    stack, calibrated = stack_from_session(session, stack_file, QUICK_PITCH_MM if quick else PITCH_MM, stages)
    write_calibration_page(calibration_page, calibrated, "halfangle demo: the calibration of the simulated rig")
    write_truth(stack_file, truth_of(rig, stack.grid))
    stack = read_stack(stack_file)
    result = result_from_stack(stack, Options(), stages, 6, calibrated.figures, stack_file)
    write_result(result_file, result)
    write_report(page, result, "halfangle demo: a simulated relief of five materials")
    figures = {**result.summary, "stages": result.stages, "choices": result.choices}
    if json_file:
        write_json(json_file, figures)
    click.echo(_text(figures))
    click.echo(checks_text(calibrated))
    click.echo("wrote " + ", ".join(map(str, files)))


def _capture(rig: RigConfig, session: Path, stages: Stages, *, quick: bool) -> None:
    from benchmarks.common.simulated import EXAMPLES
    from instrument.config.loading import load_protocol
    from protocols.capture.engine import capture

    protocol = load_protocol(EXAMPLES / ("quick_sweep.toml" if quick else "hdr_sweep.toml"))
    with stages.measure("capture"):
        capture(rig, protocol, session)


def _text(figures: dict[str, Any]) -> str:
    rows = [("stage", "seconds", "peak MB")]
    rows += [(s["name"], f"{s['seconds']:.1f}", f"{s['peak_mb']:.0f}") for s in figures["stages"]]
    rows.append(("all", f"{sum(s['seconds'] for s in figures['stages']):.1f}", ""))
    return f"{figures_table(figures)}\n\n{table(rows)}\n"
