"""Figures of the experiments on rendered scenes, as PNG small enough for a page."""

from __future__ import annotations

import io
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image

from analysis.drawing.colours import display_colours, normal_colours
from benchmarks.reproduction.mitsuba_scenes.relighting import read_linear
from instrument.files.whole_file import write_whole

Array = NDArray[np.float64]

MAX_BYTES = 200_000

_RESOLUTIONS = (110, 90, 75, 60, 45)


def save(figure: Figure, path: Path) -> Path:
    """Write a figure as fine as `MAX_BYTES` allows, in all its colours if they fit; return the path."""
    pictures = [_drawn(figure, dpi) for dpi in _RESOLUTIONS]
    # 256 colours of its own make a third of the bytes.
    sizes = [_png(pictures[0]), *(_png(picture.quantize(256)) for picture in pictures)]
    write_whole(path, next((data for data in sizes if len(data) <= MAX_BYTES), sizes[-1]), overwrite=True)
    return path


def _drawn(figure: Figure, dpi: int) -> Image.Image:
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=dpi)
    return Image.open(drawn).convert("RGB")


def _png(picture: Image.Image) -> bytes:
    data = io.BytesIO()
    picture.save(data, format="png", optimize=True)
    return data.getvalue()


def grid_of(n_rows: int, n_columns: int, width: float = 2.2, height: float = 2.2) -> tuple[Figure, NDArray[Any]]:
    """Return a figure and its axes, shape (n_rows, n_columns), without frames."""
    figure = Figure(figsize=(width * n_columns, height * n_rows), layout="constrained")
    axes = figure.subplots(n_rows, n_columns, squeeze=False)
    for ax in axes.flat:
        ax.set_axis_off()
    return figure, axes


def show(ax: Any, image: Array, title: str, **how: Any) -> Any:
    """Draw an image with a title."""
    ax.set_title(title, fontsize=8)
    return ax.imshow(image, interpolation="nearest", **how)


def show_picture(ax: Any, path: Path, title: str) -> None:
    """Draw a rendered picture."""
    show(ax, display_colours(np.asarray(read_linear(path), np.float64)), title)


def show_normals(ax: Any, normals: Array, title: str) -> None:
    """Draw normals in false colours."""
    show(ax, normal_colours(normals), title)


def show_maps(figure: Figure, axes: Sequence[Any], maps: Sequence[Array], titles: Sequence[str], label: str) -> None:
    """Draw maps of one quantity on one scale, from the 1st to the 99th percentile of all, with a bar."""
    values = np.concatenate([values.ravel() for values in maps])
    low, high = np.nanpercentile(values, [1, 99])
    for ax, image, title in zip(axes, maps, titles, strict=True):
        shown = show(ax, image, title, cmap="viridis", vmin=low, vmax=high)
    figure.colorbar(shown, ax=list(axes), label=label, shrink=0.8)
