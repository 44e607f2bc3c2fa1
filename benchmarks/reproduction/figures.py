"""Figures of the experiments: small enough for a page, all of one look."""

from __future__ import annotations

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from instrument.files.whole_file import write_whole

STYLE: dict[Any, Any] = {
    "font.size": 8,
    "axes.titlesize": 9,
    "legend.fontsize": 7,
    "axes.grid": True,
    "grid.alpha": 0.3,
    "lines.linewidth": 1.3,
    "lines.markersize": 3.5,
    "figure.facecolor": "white",
}

DPI = 100

N_COLOURS = 224


@contextmanager
def drawn(
    path: Path, n_rows: int, n_columns: int, width: float, height: float, *, shaded: bool = False, **options: Any
) -> Iterator[Any]:
    """Yield the axes of a figure of so many inches, shape (n_rows, n_columns); write it when they are drawn on.

    Parameters
    ----------
    path : Path
        PNG file; its folder is made if need be.
    n_rows, n_columns : int
    width, height : float
        Inches, at `DPI`.
    shaded : bool
        It shows pictures with smooth shades rather than lines.
    **options
        Of `matplotlib.figure.Figure.subplots`.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        axes: NDArray[np.object_] = figure.subplots(n_rows, n_columns, squeeze=False, **options)
        yield axes
        as_drawn = io.BytesIO()
        figure.savefig(as_drawn, dpi=DPI, format="png")
    # With a palette the file is a third. The thin line of a colour of its own must keep it; shades must not show steps.
    method = Image.Quantize.MEDIANCUT if shaded else Image.Quantize.MAXCOVERAGE
    with Image.open(as_drawn) as image:
        small = image.convert("RGB").quantize(N_COLOURS, method, dither=Image.Dither.NONE)
    written = io.BytesIO()
    small.save(written, format="png", optimize=True)
    path.parent.mkdir(parents=True, exist_ok=True)
    write_whole(path, written.getvalue(), overwrite=True)
