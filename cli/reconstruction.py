"""`halfangle reconstruct`, `render`, `report`: from a session or a stack to maps and pictures."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from cli.output import check_new, parse_position, write_json
from cli.progress import stage_bars

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
    from analysis.pipeline import reconstruct as run
    from analysis.reconstruction.options import Options
    from analysis.reporting.text import summary_text
    from analysis.results.result_file import write_result

    with stage_bars(quiet=quiet) as stages:
        options, scratch = Options(**choices), output.parent
        result = run(source, options, n_held_out=left_out, pitch=pitch, scratch=scratch, stages=stages)
        write_result(output, result)
    if json_file:
        write_json(json_file, result.figures())
    click.echo(f"{output}\n{summary_text(result.summary)}")


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
    from analysis.pipeline import report as write_page
    from analysis.results.result_file import read_result
    from instrument.files.probe import refuse_dangerous

    refuse_dangerous(result)
    write_page(read_result(result), output, title or result.name)
    click.echo(str(output))
