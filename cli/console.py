"""`halfangle console`."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from cli.capture import devices_with, faults_option
from cli.output import PATH


@click.command(epilog="Example: halfangle console --rig examples/simulated.toml")
@click.option("--rig", required=True, type=PATH, help="The rig to open (TOML).")
@faults_option
def console(rig: Path, faults: Path | None) -> None:
    """Open the operator's window on a rig: live picture, captures, sessions, calibrations, results.

    Closing it, Ctrl-C and killing it leave the light off; `halfangle resume` goes on with a capture that it ended.
    """
    from gui.display import display_problem
    from instrument.config.loading import load_rig

    config, devices = load_rig(rig), devices_with(faults)
    if problem := display_problem():
        raise click.ClickException(f"{problem}.")
    try:
        from gui.console import run
    except ImportError as error:
        raise click.ClickException(
            f"the console cannot start: {error}. It needs the extra halfangle[gui], "
            "and on Linux the system libraries that scripts/setup.sh names: `make setup` brings both."
        ) from None
    sys.exit(run(config, devices))
