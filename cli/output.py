"""What commands share: the kinds of their arguments, exit codes."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import click

from instrument.files import new_places


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

check_new = new_places.check_new

FINISHED_WITH_WARNINGS = 3
"""Exit code: what was asked for is done, and is not to be trusted before it has been looked at."""
