"""`halfangle point`: what was measured at one pixel of a result, against the curve that was fitted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from cli.output import finite
from instrument.files.text_table import text_table
from instrument.files.validation import InvalidInputError, Problem, printable

if TYPE_CHECKING:
    from analysis.results.points import PointCurve, PointSamples

FILE = click.Path(path_type=Path, dir_okay=False)


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
    from analysis.results.points import point_curve, point_samples, source_stack
    from analysis.results.result_file import read_result
    from instrument.files.probe import refuse_dangerous

    refuse_dangerous(result)
    read = read_result(result)
    try:
        curve = point_curve(read, row, column)
    except IndexError as error:
        raise InvalidInputError("The point cannot be shown.", [Problem(str(result), str(error))]) from None
    samples = point_samples(read, source_stack(result, read, stack), row, column)
    click.echo(json.dumps(finite(_values(curve, samples))) if as_json else _text(curve, samples))


def _values(curve: PointCurve, samples: PointSamples) -> dict[str, Any]:
    from analysis.results.points import USES

    return {
        "row": curve.row,
        "column": curve.column,
        "flags": list(curve.flags),
        "normal_sigma_rad": curve.normal_sigma,
        "theta_h_range_rad": list(curve.seen),
        "curve": {"theta_h_rad": curve.theta_h.tolist(), "f": curve.f.tolist()},
        "samples": {
            "theta_h_rad": samples.theta_h.tolist(),
            "f": samples.f.tolist(),
            "sigma": samples.sigma.tolist(),
            "use": [[USES[use] for use in view] for view in samples.use],
        },
    }


def _text(curve: PointCurve, samples: PointSamples) -> str:
    import numpy as np

    from analysis.results.points import USES

    near, far, sigma = np.rad2deg([*curve.seen, curve.normal_sigma])
    seen = f"seen from {near:.1f} to {far:.1f} deg, normal known to {sigma:.3f} deg"
    head = [f"row {curve.row}, column {curve.column}: {seen}", *(f"flag: {flag}" for flag in curve.flags)]
    names = "RGB" if curve.f.shape[1] == 3 else ("grey",)
    rows: list[tuple[str, ...]] = [("view", "channel", "theta_h, deg", "f, 1/sr", "sigma", "fitted", "use")]
    for i_view in np.argsort(samples.theta_h):
        for channel, name in enumerate(names):
            theta_h = float(samples.theta_h[i_view])
            fitted = float(np.interp(theta_h, curve.theta_h, curve.f[:, channel]))
            values = (samples.f[i_view, channel], samples.sigma[i_view, channel], fitted)
            use = USES[samples.use[i_view, channel]]
            rows.append((str(i_view), name, f"{np.rad2deg(theta_h):.2f}", *(f"{v:.5g}" for v in values), use))
    return printable("\n".join([*head, text_table(rows)]), keep="\n")
