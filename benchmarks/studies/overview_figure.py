"""One picture of a result for the documentation: python -m benchmarks.studies.overview_figure R.result.h5 out.png."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from analysis.drawing.colours import display_colours, normal_colours
from analysis.results.result import Result, diffuse_albedo
from analysis.results.result_file import read_result
from instrument.files.whole_file import written_whole


def overview(result: Result) -> Figure:
    """Draw normals, depth, albedo and the sample relit from two sides."""
    albedo = display_colours(result.as_map(diffuse_albedo(result.fits)))
    above = np.array([0.0, 0.0, 350.0])
    lights = {"relit from the left": [-220.0, 60.0, 300.0], "relit from the right": [220.0, 60.0, 300.0]}
    figure = Figure(figsize=(11, 2.6), layout="constrained")
    axes = figure.subplots(1, 5)
    axes[0].imshow(normal_colours(result.normals))
    axes[0].set_title("normals")
    low, high = np.nanpercentile(result.depth, [1, 99])
    shown = axes[1].imshow(result.depth, cmap="viridis", vmin=low, vmax=high)
    axes[1].set_title("depth, mm")
    figure.colorbar(shown, ax=axes[1], shrink=0.8)
    axes[2].imshow(albedo)
    axes[2].set_title("diffuse albedo")
    for ax, (title, light) in zip(axes[3:], lights.items(), strict=True):
        ax.imshow(display_colours(result.render(above, np.array(light))))
        ax.set_title(title)
    for ax in axes:
        ax.set_axis_off()
    return figure


if __name__ == "__main__":
    with written_whole(Path(sys.argv[2]), overwrite=True) as picture:
        overview(read_result(Path(sys.argv[1]))).savefig(picture, dpi=90, format="png")
