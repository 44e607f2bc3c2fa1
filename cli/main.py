"""Entry point of `halfangle`: finds the command, imports only that one, maps errors to exit codes."""

from __future__ import annotations

import os
import sys
from importlib import import_module
from typing import Any

import click

from drivers.errors import CancelledError, DeviceError, NotSafeError
from instrument.files.validation import LINE_BREAK, InvalidInputError, printable

# name -> (module:command, help line). The help lines stand here so that `--help` imports no command.
COMMANDS = {
    "demo": ("cli.demo:demo", "Simulated rig to scored report, in one go."),
    "devices": ("cli.devices:devices", "What is attached, and whether it can be used."),
    "rig": ("cli.devices:rig", "Look at the devices of a rig."),
    "driver-test": ("cli.devices:driver_test", "Run the tests that every driver passes on a rig's devices."),
    "plan": ("cli.capture:plan", "What a capture would take: poses, frames, time, bytes."),
    "capture": ("cli.capture:capture", "Capture a protocol on a rig into a session."),
    "resume": ("cli.capture:resume", "Go on with an interrupted session."),
    "session": ("cli.session:session", "Look at, verify, pack and export session files."),
    "boards": ("cli.calibration:boards", "The marker boards as a PDF to print."),
    "import": ("cli.importing:import_pictures", "Bring in pictures from elsewhere."),
    "calibrate": ("cli.calibration:calibrate", "Session to registered stack, with a report of checks."),
    "reconstruct": ("cli.reconstruction:reconstruct", "Session or stack to normals, depth and BRDF."),
    "render": ("cli.reconstruction:render", "Predict the picture from any camera and light."),
    "report": ("cli.reconstruction:report", "One HTML page of a result."),
    "relight": ("cli.reconstruction:relight", "One HTML page in which the light moves over a result."),
    "point": ("cli.reconstruction:point", "Samples of one pixel against its fitted curve."),
    "export": ("cli.reconstruction:export", "A result as maps or a scene for renderers."),
    "dictionary": ("cli.dictionary:dictionary", "The BRDF dictionaries that are built in."),
    "bench": ("cli.bench:bench", "Accuracy and speed on simulated scenes, against a reference."),
    "reproduce": ("cli.reproduce:reproduce", "The paper's experiments, ours against what it states."),
    "console": ("cli.console:console", "The operator's window."),
}

EPILOG = (
    "Example: halfangle demo -o out. "
    "Exit codes: 0 fine, 1 failed, 2 usage or bad input, 3 finished with warnings, 4 rig not safe."
)


class LazyGroup(click.Group):
    """A group whose commands are imported when they are called."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """Return the names in the order of a capture's way."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import the command `cmd_name`."""
        if cmd_name not in COMMANDS:
            return None
        module, attribute = COMMANDS[cmd_name][0].split(":")
        command: click.Command = getattr(import_module(module), attribute)
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """Write the commands' help lines without importing them."""
        with formatter.section("Commands"):
            formatter.write_dl([(name, text) for name, (_, text) in COMMANDS.items()])


@click.group(cls=LazyGroup, epilog=EPILOG, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="halfangle")
def halfangle() -> None:
    """Shape and reflectance of near-planar samples with one camera and one light beside its lens."""


def main(arguments: list[str] | None = None) -> Any:
    """Run `halfangle`; exit 2 on bad input, 1 on a failure that is understood, both without a traceback."""
    n_abandoned = _n_abandoned()
    try:
        return halfangle(args=arguments, prog_name="halfangle")
    except InvalidInputError as error:
        click.echo(f"halfangle: {error}", err=True)
        sys.exit(2)
    except (DeviceError, CancelledError, OSError) as error:
        click.echo(f"halfangle: {printable(str(error), keep=LINE_BREAK)}", err=True)
        _leave(4 if isinstance(error, NotSafeError) else 1, n_abandoned)


def _n_abandoned() -> int:
    # Only a command that wrote HDF5 has imported it.
    writer = sys.modules.get("instrument.files.new_hdf5")
    return 0 if writer is None else int(writer.n_abandoned())


def _leave(code: int, n_abandoned_before: int) -> None:
    """End the program; at once where HDF5 would crash on a file that the command could not write."""
    if _n_abandoned() > n_abandoned_before:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)
