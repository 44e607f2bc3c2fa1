"""`halfangle plan`, `capture` and `resume`."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from cli.output import PATH, json_option

if TYPE_CHECKING:
    from instrument.rig.rig import OpenDevices
    from protocols.capture.engine import Outcome, Progress

MAX_WARNINGS = 5

rig_option = click.option("--rig", required=True, type=PATH, help="The rig: devices, geometry, boards (TOML).")


faults_option = click.option("--faults", type=PATH, help="A script of faults, to see what a simulated rig does (TOML).")


@click.command(epilog="Example: halfangle plan examples/hdr_sweep.toml --rig examples/simulated.toml")
@click.argument("protocol", type=PATH)
@rig_option
@json_option
def plan(protocol: Path, rig: Path, as_json: bool) -> None:
    """Say what capturing PROTOCOL (TOML or Python) would do: poses, time, bytes. Nothing moves or lights."""
    from instrument.config.loading import load_rig
    from protocols.planning.estimate import estimate
    from protocols.planning.python_protocol import load_any_protocol

    outlook = estimate(load_rig(rig), load_any_protocol(protocol))
    click.echo(json.dumps(outlook.as_dict(), indent=2) if as_json else outlook.as_text())


@click.command(epilog="Example: halfangle capture examples/hdr_sweep.toml --rig examples/simulated.toml -o relief.h5")
@click.argument("protocol", type=PATH)
@rig_option
@click.option("-o", "--output", required=True, type=PATH, help="The session to write.")
@faults_option
def capture(protocol: Path, rig: Path, output: Path, faults: Path | None) -> None:
    """Capture PROTOCOL (TOML or Python) on a rig into a session file.

    Ctrl-C ends it after the pose under way, a second one at once, both with the light off; `halfangle resume` goes on.
    """
    from instrument.config.loading import load_rig
    from protocols.capture import engine
    from protocols.planning.python_protocol import load_any_protocol

    rig_config, protocol_config = load_rig(rig), load_any_protocol(protocol)
    with _bar("capture") as watch:
        outcome = engine.capture(rig_config, protocol_config, output, watch, devices_with(faults))
    _conclude(outcome)


@click.command(epilog="Example: halfangle resume relief.h5")
@click.argument("session", type=PATH)
@click.option("--accept-moved", is_flag=True, help="Do not look whether the sample lies where it lay.")
@faults_option
def resume(session: Path, accept_moved: bool, faults: Path | None) -> None:
    """Go on with an interrupted SESSION at its first incomplete pose."""
    from instrument.files.probe import refuse_dangerous
    from protocols.capture import engine

    refuse_dangerous(session)
    with _bar("resume") as watch:
        outcome = engine.resume(session, watch, devices_with(faults), accept_moved=accept_moved)
    _conclude(outcome)


def devices_with(faults: Path | None) -> OpenDevices:
    """Return what opens the devices of a rig, with the faults of a script if there is one."""
    from functools import partial

    from drivers.registry import open_devices, open_devices_with_faults
    from instrument.config.faults import load_faults

    return open_devices if faults is None else partial(open_devices_with_faults, faults=load_faults(faults))


@contextmanager
def _bar(description: str) -> Iterator[Callable[[Progress], None]]:
    from cli.progress import progress_bar

    with progress_bar(description) as step:
        yield lambda progress: step(progress.n_complete, progress.message, progress.n_poses)


def _conclude(outcome: Outcome) -> None:
    from protocols.capture.engine import Finish
    from protocols.planning.plan import duration

    for warning in outcome.warnings[:MAX_WARNINGS]:
        click.echo(f"warning: {warning}", err=True)
    if len(outcome.warnings) > MAX_WARNINGS:
        click.echo(f"warning: and {len(outcome.warnings) - MAX_WARNINGS} more, in the session's journal", err=True)
    took = f" in {duration(outcome.seconds)}" if outcome.finish is Finish.COMPLETE and outcome.seconds else ""
    click.echo(f"{outcome.path}: {outcome.n_complete} of {outcome.n_poses} poses, {outcome.message}{took}")
    if outcome.finish is not Finish.COMPLETE:
        sys.exit(1)
    if outcome.warnings:
        sys.exit(3)
