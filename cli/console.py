"""`halfangle console`."""

from __future__ import annotations

import os
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
    from instrument.config.loading import load_rig

    config, devices = load_rig(rig), devices_with(faults)
    _refuse_without_display()
    try:
        from gui.console import run
    except ImportError as error:
        raise click.ClickException(
            f"the console cannot start: {error}. It needs the extra halfangle[gui], "
            "and on Linux the system libraries that scripts/setup.sh names: `make setup` brings both."
        ) from None
    sys.exit(run(config, devices))


def _refuse_without_display() -> None:
    # Qt itself would end the process by a signal, with a page of text.
    named = ("DISPLAY", "WAYLAND_DISPLAY", "QT_QPA_PLATFORM")
    if sys.platform == "linux" and not any(map(os.environ.get, named)):
        raise click.ClickException(
            "there is no display for the window (neither DISPLAY nor WAYLAND_DISPLAY is set). Start it at a "
            "desktop, or use halfangle capture, which needs none."
        )
