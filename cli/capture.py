"""`halfangle plan`, `capture` and `resume`."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

if TYPE_CHECKING:
    from protocols.engine import Outcome, Progress

rig_option = click.option(
    "--rig", required=True, type=click.Path(path_type=Path), help="The rig: devices, geometry, boards (TOML)."
)


@click.command(epilog="Example: halfangle plan examples/hdr_sweep.toml --rig examples/simulated.toml")
@click.argument("protocol", type=click.Path(path_type=Path))
@rig_option
@click.option("--json", "as_json", is_flag=True, help="Print JSON.")
def plan(protocol: Path, rig: Path, as_json: bool) -> None:
    """Say what capturing PROTOCOL would do: poses, frames, time, bytes. Nothing moves or lights."""
    from instrument.config import load_protocol, load_rig
    from protocols.dry_run import dry_run

    outlook = dry_run(load_rig(rig), load_protocol(protocol))
    click.echo(json.dumps(outlook.as_dict(), indent=2) if as_json else outlook.as_text())


@click.command(epilog="Example: halfangle capture examples/hdr_sweep.toml --rig examples/simulated.toml -o relief.h5")
@click.argument("protocol", type=click.Path(path_type=Path))
@rig_option
@click.option("-o", "--output", required=True, type=click.Path(path_type=Path), help="The session to write.")
def capture(protocol: Path, rig: Path, output: Path) -> None:
    """Capture PROTOCOL on a rig into a session file.

    Ctrl-C ends it with the light off; `halfangle resume` goes on.
    """
    from instrument.config import load_protocol, load_rig
    from protocols import engine

    rig_config, protocol_config = load_rig(rig), load_protocol(protocol)
    with _bar("capture") as watch:
        outcome = engine.capture(rig_config, protocol_config, output, watch)
    _conclude(outcome)


@click.command(epilog="Example: halfangle resume relief.h5")
@click.argument("session", type=click.Path(path_type=Path))
def resume(session: Path) -> None:
    """Go on with an interrupted SESSION at its first incomplete pose."""
    from instrument.look import refuse_dangerous
    from protocols import engine

    refuse_dangerous(session)
    with _bar("resume") as watch:
        outcome = engine.resume(session, watch)
    _conclude(outcome)


@contextmanager
def _bar(description: str) -> Iterator[Callable[[Progress], None]]:
    from cli.progress import progress_bar

    with progress_bar(description) as step:
        yield lambda progress: step(progress.n_complete, progress.message, progress.n_poses)


def _conclude(outcome: Outcome) -> None:
    from protocols.engine import State

    click.echo(f"{outcome.path}: {outcome.n_complete} of {outcome.n_poses} poses, {outcome.message}")
    if outcome.state is not State.SAFE:
        sys.exit(1)
