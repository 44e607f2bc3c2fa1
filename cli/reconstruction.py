"""`halfangle reconstruct`, `render`, `report`: from a session or a stack to maps and pictures."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import click

from cli.calibration import budget_text, stack_from_session
from cli.output import check_new, parse_position, stage_announcer, table, write_json

if TYPE_CHECKING:
    from analysis.reconstruction.reconstruction import Options
    from analysis.registration.stack import Stack
    from analysis.results.result import Result
    from analysis.stages import Stages

FILE = click.Path(path_type=Path, dir_okay=False)


def _one_of(name: str, values: list[str], default: str, text: str) -> Callable[[Any], Any]:
    """Return the option `name` that takes one of `values`."""
    return click.option(name, type=click.Choice(values), default=default, show_default=True, help=text)


@click.command(epilog="Example: halfangle reconstruct area.stack.h5 -o area.result.h5 --accuracy best")
@click.argument("source", type=FILE)
@click.option("-o", "--output", type=FILE, required=True, help="Result file to write.")
@_one_of(
    "--accuracy",
    ["draft", "normal", "best"],
    "normal",
    "How often the geometry is updated from the depth: 0, 2 or 4 times.",
)
@click.option(
    "--dictionary",
    default="parametric",
    show_default=True,
    metavar="NAME|FILE",
    help="BRDF atoms to fit with: parametric, sgd, abc, or a file made by `halfangle dictionary build`.",
)
@_one_of(
    "--light",
    ["auto", "given", "collocated", "estimate"],
    "auto",
    "Where the light is: as the file says (refined if uncertain), as it says, in the lens, from the highlights.",
)
@_one_of("--parallax", ["auto", "on", "off"], "auto", "Whether the views are made to follow the depth.")
@_one_of(
    "--palette",
    ["auto", "on", "off"],
    "auto",
    "Whether pixels mix few materials that the scene shares, found from it, or stand on their own.",
)
@_one_of(
    "--power",
    ["auto", "given", "estimate"],
    "auto",
    "Whether each view's light power is corrected by what the whole scene says (needs a palette).",
)
@_one_of(
    "--field",
    ["auto", "near", "far"],
    "auto",
    "Whether each pixel has its own directions and fall-off, or that of the centre.",
)
@click.option("--independent", is_flag=True, help="Pixels have nothing to do with each other: no depth.")
@click.option("--pitch", type=click.FloatRange(min=0.001), help="For a session: size of a pixel, mm.")
@click.option(
    "--left-out",
    type=click.IntRange(min=0),
    default=6,
    show_default=True,
    help="Views to leave out in turn and predict.",
)
@click.option("--threads", type=click.IntRange(min=1), help="[default: all processors]")
@click.option("--seed", type=int, default=0, show_default=True, help="Of the pixels drawn for evidence.")
@click.option("--json", "json_file", type=FILE, help="Write the figures here too.")
@click.option("-q", "--quiet", is_flag=True, help="Say nothing while working.")
def reconstruct(
    source: Path, output: Path, pitch: float | None, left_out: int, json_file: Path | None, quiet: bool, **choices: Any
) -> None:
    """Reconstruct normals, depth and BRDF from a SOURCE: a session or a registered stack."""
    check_new(output, *([json_file] if json_file else []))
    from analysis.reconstruction.reconstruction import Options
    from analysis.reflectance.dictionary import by_name
    from analysis.results.result_file import write_result
    from analysis.stages import Stages
    from instrument.files.probe import refuse_dangerous

    refuse_dangerous(source)
    refuse_dangerous(Path(choices["dictionary"]))
    # Before a session is registered, which takes minutes.
    by_name(choices["dictionary"])
    stages = Stages(stage_announcer(quiet))
    with TemporaryDirectory(prefix=".halfangle-", dir=output.parent) as scratch:
        stack, calibration = read_source(source, Path(scratch) / "area.stack.h5", pitch, stages)
        result = result_from_stack(stack, Options(**choices), stages, left_out, calibration, source)
        write_result(output, result)
    if json_file:
        write_json(json_file, {**result.summary, "stages": result.stages, "choices": result.choices})
    click.echo(f"{output}\n{figures_table(result.summary)}")


def read_source(source: Path, registered: Path, pitch: float | None, stages: Stages) -> tuple[Stack, dict[str, Any]]:
    """Read a registered stack, or register a session into `registered`; return it and the calibration's figures."""
    from analysis.registration.stack_file import is_stack, read_stack
    from instrument.files.json_text import parse_json

    if not is_stack(source):
        stack, report = stack_from_session(source, registered, pitch, stages)
        return stack, report.figures
    with stages.measure("reading"):
        stack = read_stack(source)
    text = stack.notes.get("calibration")
    return stack, parse_json(text) if text else {}


def result_from_stack(
    stack: Stack, options: Options, stages: Stages, left_out: int, calibration: dict[str, Any], source: Path
) -> Result:
    """Reconstruct and score; `source` is the file that the stack came from, for provenance."""
    from analysis.evaluation.scoring import score, truth_error
    from analysis.reconstruction.reconstruction import reconstruct as run
    from analysis.results.result import result_of

    reconstruction = run(stack, options, stages)
    with stages.measure("views left out"):
        summary = score(reconstruction, left_out)
    with source.open("rb") as file:
        digest = hashlib.file_digest(file, "sha256").hexdigest()
    summary |= {"options": asdict(options), "source": {"file": source.name, "sha256": digest}}
    if calibration:
        summary["calibration"] = calibration
    return result_of(reconstruction, stages, summary, truth_error(reconstruction))


def figures_table(summary: dict[str, Any]) -> str:
    """Return the figures that a user looks at first, as text."""
    rows: list[tuple[str, ...]] = [("", "mean", "median", "95 %")]
    for name, key in (("normal error, deg", "normal_error_deg"), ("stated sigma, deg", "normal_sigma_deg")):
        if key in summary:
            rows.append((name, *(f"{summary[key][k]:.3f}" for k in ("mean", "median", "p95"))))
    text = [table(rows)]
    if "depth_rmse_mm" in summary:
        plane = summary["depth_rmse_without_plane_mm"]
        text.append(f"depth RMSE {summary['depth_rmse_mm']:.4f} mm, {plane:.4f} mm with the plane removed")
        inside = f"{100 * summary['coverage68']:.0f} % and {100 * summary['coverage95']:.0f} %"
        text.append(f"stated 68 % and 95 % normal intervals hold {inside} of the true normals")
    if "depth_shape" in summary:
        shape = summary["depth_shape"]
        tilt = f"({shape['tilt_x']:.5f}, {shape['tilt_y']:.5f}) mm/mm"
        text.append(f"plane and bowl in the depth: tilt {tilt}, bowl {shape['sag']:.4f} mm deep")
    if "error_budget_deg" in summary:
        text.append(budget_text(summary["error_budget_deg"]))
    if summary["n_unsolved"]:
        text.append(f"{summary['n_unsolved']} of {summary['n_pixels']} pixels unsolved (see flags)")
    if summary["left_out"]:
        rows = [("view left out", "relative RMS", "Lambertian", "PSNR dB", "Lambertian", "gain on glossy dB")]
        for v in summary["left_out"]:
            shares = (f"{100 * v[k]:.2f} %" for k in ("relative_rms", "lambert_relative_rms"))
            levels = (f"{v[k]:.1f}" for k in ("psnr_db", "lambert_psnr_db", "glossy_gain_db"))
            rows.append((str(v["view"]), *shares, *levels))
        text.append(table(rows))
    return "\n".join(text)


@click.command(epilog="Example: halfangle render area.result.h5 --camera 0,0,350 --light 120,0,300 -o relit.exr")
@click.argument("result", type=FILE)
@click.option("--camera", required=True, metavar="X,Y,Z", help="Sample frame, mm.")
@click.option("--light", required=True, metavar="X,Y,Z", help="Sample frame, mm.")
@click.option("--light-power", type=click.FloatRange(min=0.0), default=1.0, show_default=True, help="As in the stack.")
@click.option(
    "-o", "--output", type=FILE, required=True, help="Picture to write: .exr or .npy (linear) or .png (display)."
)
def render(result: Path, camera: str, light: str, light_power: float, output: Path) -> None:
    """Predict the picture of the area from any CAMERA and LIGHT, in the stack's radiance units and grid."""
    check_new(output)
    from analysis.drawing.picture_file import check_picture_name, write_picture
    from analysis.results.result_file import read_result
    from instrument.files.probe import refuse_dangerous

    check_picture_name(output)
    refuse_dangerous(result)
    positions = parse_position(camera, "--camera"), parse_position(light, "--light")
    radiance = read_result(result).render(*positions, light_power)
    write_picture(output, radiance)
    click.echo(f"{output}: {radiance.shape[1]} x {radiance.shape[0]} pixels")


@click.command(epilog="Example: halfangle report area.result.h5 -o report.html")
@click.argument("result", type=FILE)
@click.option("-o", "--output", type=FILE, required=True, help="HTML page to write; needs nothing beside it.")
@click.option("--title", help="[default: the file's name]")
def report(result: Path, output: Path, title: str | None) -> None:
    """Make one HTML page of a RESULT."""
    check_new(output)
    from analysis.reporting.result_report import write_report
    from analysis.results.result_file import read_result
    from instrument.files.probe import refuse_dangerous

    refuse_dangerous(result)
    write_report(output, read_result(result), title or result.name)
    click.echo(str(output))
