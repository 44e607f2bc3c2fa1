"""What commands share: the kinds of their arguments, where files may go, exit codes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click
import numpy as np

from instrument.files.validation import InvalidInputError, Problem


class FiniteRange(click.FloatRange):
    """A number within limits; NaN, which no limit keeps out, and infinities are refused."""

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> float:
        """Return the number."""
        number = float(super().convert(value, param, ctx))
        return number if math.isfinite(number) else self.fail(f"{value} is no finite number.", param, ctx)


PATH = click.Path(path_type=Path)
FILE = click.Path(path_type=Path, dir_okay=False)
FOLDER = click.Path(path_type=Path, file_okay=False)

json_option = click.option("--json", "as_json", is_flag=True, help="Print JSON.")
json_file_option = click.option("--json", "json_file", type=FILE, help="Write the figures here too.")
quiet_option = click.option("-q", "--quiet", is_flag=True, help="Say nothing while working.")

FINISHED_WITH_WARNINGS = 3
"""Exit code: what was asked for is done, and is not to be trusted before it has been looked at."""


def check_new(*paths: Path) -> None:
    """Refuse to write where there is a file already, or where there is no folder, all at once.

    Raises
    ------
    InvalidInputError
    """
    problems = [
        Problem(str(path), "exists and is not overwritten; choose another name") for path in paths if path.exists()
    ]
    problems += [
        Problem(str(path.parent), f"is no folder; make it first, to write {path.name} there")
        for path in paths
        if not path.parent.is_dir()
    ]
    if problems:
        raise InvalidInputError("Nothing was written.", problems)


def parse_position(text: str, name: str) -> np.ndarray[Any, np.dtype[np.float64]]:
    """Parse ``"X,Y,Z"`` in mm of the sample frame.

    Raises
    ------
    InvalidInputError
    """
    try:
        position = np.array([float(part) for part in text.split(",")])
    except ValueError:
        position = np.zeros(0)
    if position.shape != (3,) or not np.all(np.isfinite(position)) or position[2] <= 0:
        what = f"is {text!r}; must be X,Y,Z in mm of the sample frame with Z above the sample, e.g. 0,0,350"
        raise InvalidInputError("The position cannot be used.", [Problem(name, what)])
    return position
