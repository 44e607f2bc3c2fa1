"""Figures of the experiments: small enough for a page, all of one look."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

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
def drawn(path: Path, n_rows: int, n_columns: int, width: float, height: float, **options: Any) -> Iterator[Any]:
    """Yield the axes of a figure of so many inches, shape (n_rows, n_columns); write it when they are drawn on.

    Parameters
    ----------
    path : Path
        PNG file; its folder is made if need be.
    n_rows, n_columns : int
    width, height : float
        Inches, at `DPI`.
    **options
        Of `matplotlib.figure.Figure.subplots`.
    """
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(width, height), layout="constrained")
        axes: NDArray[np.object_] = figure.subplots(n_rows, n_columns, squeeze=False, **options)
        yield axes
        path.parent.mkdir(parents=True, exist_ok=True)
        figure.savefig(path, dpi=DPI)
    # Renderings do not compress; with a palette the file is a third.
    with Image.open(path) as image:
        image.convert("RGB").quantize(N_COLOURS, dither=Image.Dither.NONE).save(path, optimize=True)
