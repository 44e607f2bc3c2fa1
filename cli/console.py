"""`halfangle console`."""

from __future__ import annotations

import sys
from pathlib import Path

import click


@click.command(epilog="Example: halfangle console --rig examples/simulated.toml")
@click.option("--rig", required=True, type=click.Path(path_type=Path), help="The rig to open (TOML).")
def console(rig: Path) -> None:
    """Open the operator's window on a rig: its live picture, its light, its exposure time."""
    from instrument.config import load_rig

    config = load_rig(rig)
    try:
        from gui.console import run
    except ImportError as error:
        raise click.ClickException(
            f"the console cannot start: {error}. It needs the extra halfangle[gui], "
            "and on Linux the system libraries that scripts/setup.sh names."
        ) from None
    sys.exit(run(config))
