"""Pictures side by side, as PNG."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure
from numpy.typing import NDArray

from instrument.files.whole_file import written_whole

_HEIGHT, _DPI = 2.7, 80  # inches a row; a picture is as wide, but for its share of the margins


def draw_row(pictures: Mapping[str, NDArray[Any]], path: Path) -> None:
    """Draw pictures in a row, each under its title, and write them over what is there.

    Parameters
    ----------
    pictures : mapping of str to ndarray, shape (H, W) or (H, W, 3)
        By title; numbers in colours of matplotlib's, or R, G, B.
    path : Path
        PNG.

    Raises
    ------
    NotWrittenError
        If the disk or the folder does not take it.
    """
    figure = Figure(figsize=(0.8 * _HEIGHT * len(pictures), _HEIGHT), layout="constrained")
    for ax, (title, shown) in zip(figure.subplots(1, len(pictures)), pictures.items(), strict=True):
        ax.imshow(shown)
        ax.set_title(title, fontsize=9)
        ax.set_axis_off()
    with written_whole(path, overwrite=True) as part:
        figure.savefig(part, dpi=_DPI, format="png")
