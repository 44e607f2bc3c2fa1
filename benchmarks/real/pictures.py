"""A capture as a picture: a photograph that was left out beside what the others say of it, and the maps."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.drawing.colours import display_colours, normal_colours
from analysis.few_views.method import binning_for
from analysis.pixels.problem import sample_pixels
from analysis.reconstruction.left_out import fits_without, foretold, predicted
from analysis.reconstruction.reconstruction import Reconstruction
from benchmarks.common.pictures import draw_row

Array = NDArray[np.float64]


def draw(found: Reconstruction, path: Path) -> None:
    """Draw the photograph of a view in the middle, left out and predicted, with normals and depth.

    Parameters
    ----------
    found : Reconstruction
    path : Path
        PNG, written over.
    """
    view = found.stack.n_views // 2
    photograph, told = _left_out(found, view)
    white = float(np.nanpercentile(photograph, 99))
    pictures = {
        "photograph, left out": display_colours(photograph, white),
        "as the others say it": display_colours(told, white),
        "normals": normal_colours(found.normals),
        "depth, mm": found.depth,
    }
    draw_row(pictures, path)


def _left_out(found: Reconstruction, view: int) -> tuple[Array, Array]:
    if found.few_views is not None:
        without = foretold(view, found.few_views, binning_for(found.few_views.stack), seed=0, threads=None)
        shown = np.asarray(without.stack.radiance[view], np.float64)
        return shown, without.radiance.reshape(shown.shape)
    photograph = np.asarray(found.stack.radiance[view], np.float64)
    # Holes say nothing, and are not asked.
    pixels = sample_pixels(found.stack, photograph[..., 0].size, np.random.default_rng(0))
    fits = fits_without(
        view,
        pixels,
        stack=found.stack,
        dictionary=found.fits.dictionary,
        noise=found.noise,
        depth=found.depth,
        scene=found.palette,
    )
    told = np.full(photograph.shape, np.nan)
    told.reshape(-1, photograph.shape[2])[pixels] = predicted(fits, found.stack, view, pixels, found.depth)
    return photograph, told
