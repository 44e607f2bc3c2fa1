"""Maps as pictures with a colour bar, as PNG bytes."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.colors import LogNorm, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

Array = NDArray[np.float64]

Point = tuple[int, int]
"""Row and column."""

STYLE: dict[Any, Any] = {"font.size": 9, "axes.titlesize": 10, "figure.facecolor": "white", "savefig.dpi": 110}


def picture(colours: Array) -> bytes:
    """Encode display colours (height, width, 3) pixel by pixel."""
    buffer = io.BytesIO()
    mpl.image.imsave(buffer, np.asarray(np.clip(colours, 0, 1)), format="png")
    return buffer.getvalue()


def scalar_map(values: Array, label: str, *, log: bool = False, marks: Sequence[Point] = ()) -> bytes:
    """Draw a map with its colour bar; the scale spans the 1st to the 99th percentile."""
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(4.2, 3.5), layout="constrained")
        axes = figure.add_subplot()
        finite = values[np.isfinite(values)]
        low, high = np.percentile(finite, [1, 99]) if finite.size else (0.0, 1.0)
        if log:
            norm: Normalize = LogNorm(max(low, 1e-6), max(high, 2e-6))
        else:
            norm = Normalize(low, high if high > low else low + 1e-6)
        shown = axes.imshow(
            values, norm=norm, cmap=mpl.colormaps["viridis"].with_extremes(bad="black"), interpolation="nearest"
        )
        figure.colorbar(shown, ax=axes, label=label, shrink=0.9)
        for number, (row, column) in enumerate(marks, start=1):
            axes.plot(column, row, "o", color="white", markeredgecolor="black", markersize=5)
            axes.annotate(str(number), (column, row), xytext=(4, 4), textcoords="offset points", color="white")
        axes.set_axis_off()
        return png(figure)


def group_map(groups: NDArray[np.int16]) -> bytes:
    """Draw a map of group numbers in distinct colours; -1 is black."""
    palette = mpl.colormaps["tab20"](np.arange(20) % 20)[:, :3]
    return picture(np.where(groups[..., None] < 0, 0.0, palette[np.maximum(groups, 0) % 20]))


def png(figure: Figure) -> bytes:
    """Encode a figure."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png")
    return buffer.getvalue()
