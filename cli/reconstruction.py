"""`halfangle reconstruct`, `render`, `report`, `point`: from a session or a stack to maps, pictures and curves."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import click

from analysis.reconstruction.options import Accuracy, Field, Light, Neighbours, Options, Palette, Parallax, Power
from cli.output import (
    FILE,
    FINISHED_WITH_WARNINGS,
    FiniteRange,
    check_new,
    json_file_option,
    parse_position,
    quiet_option,
)
from cli.progress import stage_bars
from instrument.files.json_file import write_json
from instrument.files.validation import InvalidInputError, Problem


def _one_of(name: str, words: Any, default: str, text: str) -> Callable[[Any], Any]:
    """Return the option `name` that takes one of the words of a Literal."""
    return click.option(name, type=click.Choice(get_args(words)), default=default, show_default=True, help=text)


_DICTIONARY = "Atoms to fit with: auto (parametric; in domes lambert), parametric, lambert, sgd, abc, or a file."
_LIGHT = "Where the light is: as the file says (refined if uncertain), as it says, in the lens, from the highlights."
_PALETTE = "Whether pixels mix few shared materials, found from solved pixels or by colour, or stand on their own."
_POWER = "Whether each view's light power is corrected by what the whole scene says (needs a palette)."
_NEIGHBOURS = "Whether normals are told by their neighbours' too, as strongly as the scene is smooth."
_FIELD = "Whether each pixel has its own directions and fall-off, or that of the centre."


@click.command(epilog="Example: halfangle reconstruct area.stack.h5 -o area.result.h5 --accuracy best")
@click.argument("source", type=FILE)
@click.option("-o", "--output", type=FILE, required=True, help="Result file to write.")
@_one_of("--accuracy", Accuracy, "normal", "How often the geometry is updated from the depth: 0, 2 or 4 times.")
@click.option("--dictionary", default="auto", show_default=True, metavar="NAME|FILE", help=_DICTIONARY)
@_one_of("--light", Light, "auto", _LIGHT)
@_one_of("--parallax", Parallax, "auto", "Whether the views are made to follow the depth.")
@_one_of("--palette", Palette, "auto", _PALETTE)
@_one_of("--power", Power, "auto", _POWER)
@_one_of("--field", Field, "auto", _FIELD)
@_one_of("--neighbours", Neighbours, "auto", _NEIGHBOURS)
@click.option("--independent", is_flag=True, help="Pixels have nothing to do with each other: no depth.")
@click.option("--pitch", type=FiniteRange(min=0.001), help="For a session: size of a pixel, mm.")
@click.option("--left-out", type=click.IntRange(0), default=6, show_default=True, help="Views to hold out and predict.")
@click.option("--threads", type=click.IntRange(min=1), help="[default: all processors]")
@click.option("--seed", type=click.IntRange(0), default=0, show_default=True, help="Of the pixels drawn for evidence.")
@json_file_option
@quiet_option
def reconstruct(
    source: Path, output: Path, pitch: float | None, left_out: int, json_file: Path | None, quiet: bool, **choices: Any
) -> None:
    """Reconstruct normals, depth and BRDF from a SOURCE: a session or a registered stack."""
    check_new(output, *([json_file] if json_file else []))
    from analysis.pipeline import reconstruct as run
    from analysis.reporting.text import summary_text
    from analysis.results.result_file import write_result
    from analysis.results.trust import failures

    with stage_bars(quiet=quiet) as stages:
        options, scratch = Options(**choices), output.parent
        result = run(source, options, n_held_out=left_out, pitch=pitch, scratch=scratch, stages=stages)
        write_result(output, result)
    if json_file:
        write_json(json_file, result.figures())
    click.echo(f"{output}\n{summary_text(result.summary)}")
    if failures(result.summary):
        sys.exit(FINISHED_WITH_WARNINGS)


@click.command(epilog="Example: halfangle render area.result.h5 --camera 0,0,350 --light 120,0,300 -o relit.exr")
@click.argument("result", type=FILE)
@click.option("--camera", required=True, metavar="X,Y,Z", help="Sample frame, mm.")
@click.option("--light", required=True, metavar="X,Y,Z", help="Sample frame, mm.")
@click.option("--light-power", type=FiniteRange(min=0.0), default=1.0, show_default=True, help="As in the stack.")
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


@click.command(epilog="Example: halfangle point area.result.h5 120 80 --json")
@click.argument("result", type=FILE)
@click.argument("row", type=int)
@click.argument("column", type=int)
@click.option("--stack", type=FILE, help="The stack that the result came from [default: looked for beside it].")
@click.option("--json", "as_json", is_flag=True, help="Print samples and curve as JSON.")
def point(result: Path, row: int, column: int, stack: Path | None, as_json: bool) -> None:
    """Print the samples of one pixel of a RESULT, one for each view and channel, beside its fitted curve.

    ROW and COLUMN count from 0 at the top left.
    """
    from analysis.reporting.text import point_figures, point_text
    from analysis.results.points import point_curve, point_samples, source_stack
    from analysis.results.result_file import read_result
    from instrument.files.json_file import finite
    from instrument.files.probe import refuse_dangerous

    refuse_dangerous(result)
    read = read_result(result)
    try:
        curve = point_curve(read, row, column)
    except IndexError as error:
        raise InvalidInputError("The point cannot be shown.", [Problem(str(result), str(error))]) from None
    samples = point_samples(read, source_stack(result, read, stack), row, column)
    click.echo(json.dumps(finite(point_figures(curve, samples))) if as_json else point_text(curve, samples))
