"""`halfangle reconstruct`, `render`, `export`, `report`, `relight`, `point`: from stacks to maps, pictures, pages."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

import click

from analysis.export.options import ExportOptions, Normals, Target, parse_crop
from analysis.reconstruction.options import Accuracy, Field, Light, Neighbours, Options, Palette, Parallax, Power
from cli.output import (
    FILE,
    FINISHED_WITH_WARNINGS,
    PATH,
    FiniteRange,
    check_new,
    json_file_option,
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
@click.option("-o", "--output", type=FILE, required=True, help="Picture: .exr or .npy (linear) or .png (display).")
def render(result: Path, camera: str, light: str, light_power: float, output: Path) -> None:
    """Predict the picture of the area from any CAMERA and LIGHT, in the stack's radiance units and grid."""
    check_new(output)
    from analysis.drawing.picture_file import check_picture_name, write_picture
    from analysis.results.positions import parse_position
    from analysis.results.result_file import open_result

    check_picture_name(output)
    positions = parse_position(camera, "--camera"), parse_position(light, "--light")
    radiance = open_result(result).render(*positions, light_power)
    write_picture(output, radiance)
    click.echo(f"{output}: {radiance.shape[1]} x {radiance.shape[0]} pixels")


_TO = "What to write; all but gltf is a folder of maps."
_WHITE = "Reflectance of the white that the result takes for 1."
_CROP = "A part of the area, pixels from the top left."


@click.command(epilog="Example: halfangle export area.result.h5 --to gltf -o area.glb")
@click.argument("result", type=FILE)
@click.option("--to", "target", type=click.Choice(get_args(Target)), default="maps", show_default=True, help=_TO)
@click.option("-o", "--output", type=PATH, required=True, help="Folder to write; for gltf a file that ends in .glb.")
@click.option("--normals", type=click.Choice(get_args(Normals)), help="Which normal maps.  [default: both]")
@click.option("--white-reflectance", type=FiniteRange(0.0, min_open=True), help=_WHITE)
@click.option("--crop", metavar="X,Y,W,H", callback=lambda _c, _p, text: text and parse_crop(text), help=_CROP)
@click.option("--resolution", type=click.IntRange(1), help="Pixels of the longer side; maps are averaged.")
@click.option("--mesh", type=click.IntRange(1), help="For gltf: a displaced mesh of so many cells, not a plane.")
def export(result: Path, output: Path, **choices: Any) -> None:
    """Write a RESULT as maps or as a scene for renderers (docs/export.md), and tell how true pictures of it are."""
    options = ExportOptions(**choices)
    check_new(output)
    from analysis.export.export import export_result
    from analysis.export.record import record_text
    from analysis.results.result_file import open_result

    record = export_result(open_result(result), output, options, result.name)
    click.echo(f"{output}\n{record_text(record)}")


@click.command(epilog="Example: halfangle report area.result.h5 -o report.html")
@click.argument("result", type=FILE)
@click.option("-o", "--output", type=FILE, required=True, help="HTML page to write; needs nothing beside it.")
@click.option("--title", help="[default: the file's name]")
def report(result: Path, output: Path, title: str | None) -> None:
    """Make one HTML page of a RESULT."""
    check_new(output)
    from analysis.pipeline import report as write_page
    from analysis.results.result_file import open_result

    write_page(open_result(result), output, title or result.name)
    click.echo(str(output))


@click.command(epilog="Example: halfangle relight area.result.h5 -o page.html")
@click.argument("result", type=FILE)
@click.option("-o", "--output", type=FILE, required=True, help="HTML page to write; needs nothing beside it.")
@click.option("--resolution", type=click.IntRange(1, 4096), default=1024, show_default=True, help="Most pixels a side.")
def relight(result: Path, output: Path, resolution: int) -> None:
    """Make one HTML page of a RESULT in which the light can be moved."""
    check_new(output)
    from analysis.export.page.page import relight as write_page

    click.echo(f"{output}\n{write_page(result, output, resolution)}")


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
    from analysis.results.result_file import open_result
    from instrument.files.json_file import finite

    read = open_result(result)
    try:
        curve = point_curve(read, row, column)
    except IndexError as error:
        raise InvalidInputError("The point cannot be shown.", [Problem(str(result), str(error))]) from None
    samples = point_samples(read, source_stack(result, read, stack), row, column)
    click.echo(json.dumps(finite(point_figures(curve, samples))) if as_json else point_text(curve, samples))
