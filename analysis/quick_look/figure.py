"""The picture of a quick look: normals in false colours, and how many views reach which half angle."""

from __future__ import annotations

from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from analysis.drawing.colours import normal_colours
from analysis.drawing.figures import STYLE, png
from analysis.quick_look.quick_look import QuickLook
from analysis.registration.coverage import JUDGED_TO_DEG, Coverage
from instrument.files.validation import InvalidInputError, Problem
from instrument.files.whole_file import write_whole


def write_quick_figure(path: Path, look: QuickLook, session: Path) -> None:
    """Write the picture of a quick look at `session`.

    Raises
    ------
    InvalidInputError
        If there are no normals to show.
    """
    if look.problems:
        problems = [Problem(str(session), what) for what in look.problems]
        raise InvalidInputError(f"There are no normals to draw; {path} was not written.", problems)
    write_whole(path, quick_figure(look))


def quick_figure(look: QuickLook) -> bytes:
    """Draw a quick look of at least one pose as PNG bytes."""
    assert look.coverage is not None
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(8.4, 3.8), layout="constrained")
        left, right = figure.subplots(1, 2)
        _draw_normals(left, look)
        _draw_coverage(right, look.coverage)
        return png(figure)


def _draw_normals(axes: Axes, look: QuickLook) -> None:
    height, width = look.sigma_deg.shape
    x, y = 0.5 * width * look.pitch, 0.5 * height * look.pitch
    axes.imshow(normal_colours(look.normals), extent=(-x, x, -y, y), interpolation="nearest")
    axes.set(title=f"normals of {len(look.used)} poses", xlabel="x, mm", ylabel="y, mm")


def _draw_coverage(axes: Axes, coverage: Coverage) -> None:
    widths = np.diff(coverage.edges_deg)
    axes.bar(coverage.edges_deg[:-1], coverage.all_over, widths, align="edge", edgecolor="white")
    axes.axvline(JUDGED_TO_DEG, linestyle="--", color="black", linewidth=0.8)
    axes.set(title="coverage", xlabel="half angle, deg", ylabel="views of a point, mean")
