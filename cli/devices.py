"""`halfangle devices`, `rig check` and `driver-test`: what is attached, and whether it does what it should."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cli.output import PATH, FiniteRange, check_new, json_option
from instrument.files.validation import LINE_BREAK, printable

if TYPE_CHECKING:
    from drivers.driver import Kind

rig_argument = click.argument("rig_file", metavar="RIG", type=PATH)
home_option = click.option("--home", is_flag=True, help="Let the stage find its zero first, over its whole way.")


@click.command(epilog="Example: halfangle devices")
@json_option
def devices(as_json: bool) -> None:
    """List what is attached: found, unknown, busy or without permission, each with what to do.

    Nothing is opened that might move, shine or restart; `halfangle rig check` talks to the devices of a rig.
    """
    from drivers.discovery import discover, discovery_figures, discovery_text

    found = discover()
    click.echo(
        json.dumps(discovery_figures(found), indent=2) if as_json else printable(discovery_text(found), keep=LINE_BREAK)
    )


@click.group()
def rig() -> None:
    """Look at the devices of a rig."""


@rig.command(epilog="Example: halfangle rig check examples/simulated.toml")
@rig_argument
@home_option
@click.option("--linearity", is_flag=True, help="Also: are counts proportional to light? Needs a white plate.")
@json_option
def check(rig_file: Path, home: bool, linearity: bool, as_json: bool) -> None:
    """Connect to each device of RIG (TOML), read it back, blink, move each axis a little, take a frame.

    Exit 1 if anything fails, 3 if there are warnings. The light is off and the stage rests when it ends.
    """
    from instrument.config.loading import load_rig
    from instrument.rig.check import check_rig

    findings = []
    for finding in check_rig(load_rig(rig_file), home=home, linearity=linearity):
        findings.append(finding)
        if not as_json:
            click.echo(printable(f"{finding.verdict}  {finding.kind:<6}  {finding.text}", keep=LINE_BREAK))
    if as_json:
        click.echo(json.dumps([asdict(finding) for finding in findings], indent=2))
    verdicts = {finding.verdict for finding in findings}
    if "FAIL" in verdicts:
        sys.exit(1)
    if "WARN" in verdicts:
        sys.exit(3)


@rig.command(epilog="Example: halfangle rig safe examples/simulated.toml")
@rig_argument
def safe(rig_file: Path) -> None:
    """Switch the light of RIG (TOML) off, stop its stage and its camera.

    A rig that another program holds is that program's to make safe: end it, and the light goes off.
    """
    from instrument.config.loading import load_rig
    from instrument.rig.rig import Rig

    with Rig.connected(load_rig(rig_file)):
        # Leaving it is what makes it safe, or raises.
        pass
    click.echo("the light is off, stage and camera are stopped")


@rig.command(epilog="Example: halfangle rig frame examples/simulated.toml --exposure-time 0.02 -o frame.png")
@rig_argument
@click.option(
    "--exposure-time", type=FiniteRange(min=0.0, min_open=True), default=0.01, show_default=True, help="Seconds."
)
@click.option("--region", type=int, nargs=4, metavar="TOP LEFT BOTTOM RIGHT", help="What the numbers are of, pixels.")
@click.option("-o", "--output", type=PATH, help="Picture of the raw counts to write (PNG, TIFF).")
@json_option
def frame(
    rig_file: Path, exposure_time: float, region: tuple[int, int, int, int] | None, output: Path | None, as_json: bool
) -> None:
    """Take one frame of RIG (TOML) in the light: how bright, how sharp it is, and which boards it shows."""
    from analysis.camera.live_boards import see_boards
    from instrument.config.loading import load_rig
    from instrument.pictures.counts import check_counts_name, write_counts
    from instrument.rig.frame_statistics import Region, frame_facts
    from instrument.rig.rig import Rig
    from protocols.acquisition.shot import take_single_frame

    config = load_rig(rig_file)
    if output is not None:
        check_counts_name(output)
        check_new(output)
    with Rig.connected(config) as ready:
        taken, camera = take_single_frame(ready, exposure_time), ready.camera.describe()
    facts = frame_facts(taken.counts, camera, Region(*region) if region else None)
    boards = [board.record for board in config.boards]
    seen = see_boards(taken.counts, camera.bayer_pattern, boards, config.camera.focal_length_px)
    if output is not None:
        write_counts(output, taken.counts)
    figures = {
        "exposure_time_s": taken.exposure_time,
        "median_counts": facts.median,
        "clipped": facts.clipped,
        "black": facts.black,
        "focus": facts.focus,
        "n_boards": seen.n_boards,
        "board_rms_px": None if isnan(seen.rms_px) else seen.rms_px,
    }
    click.echo(json.dumps(figures, indent=2) if as_json else "\n".join(f"{k:<16} {v}" for k, v in figures.items()))


@click.command("driver-test", epilog="Example: halfangle driver-test examples/simulated.toml --kind light")
@rig_argument
@click.option("--kind", "kinds", multiple=True, type=click.Choice(["camera", "light", "stage"]), help="Only this kind.")
@click.option("-y", "--yes", is_flag=True, help="Do not ask before a real stage moves and a real light shines.")
def driver_test(rig_file: Path, kinds: tuple[Kind, ...], yes: bool) -> None:
    """Run the tests that every driver passes on the devices of RIG (TOML).

    The stage moves to both ends of every axis and the light shines at full level: take the sample away. Exit 1 if a
    test fails.
    """
    from drivers.registry import KINDS, is_simulated
    from instrument.config.loading import load_rig
    from instrument.rig.lock import hold

    config = load_rig(rig_file)
    tables = config.model_dump(exclude_none=True)
    if not (yes or is_simulated(tables)):
        click.confirm("The stage will move over its whole way, the light will shine. Is the sample away?", abort=True)
    with hold(config.name):
        sys.exit(0 if _contracts()(tables, kinds or KINDS) else 1)


def _contracts() -> Callable[[Mapping[str, Any], Sequence[Kind]], bool]:
    from drivers.errors import DriverNotFoundError

    try:
        from drivers.contracts.bench import run_contracts
    except ModuleNotFoundError:
        raise DriverNotFoundError(
            'driver-test needs pytest. Install it: `make setup`, or pip install "halfangle[dev]"'
        ) from None
    return run_contracts
