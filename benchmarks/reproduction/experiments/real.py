"""Seven photographs of a printed foil card by a phone and its torch: maps, and each photograph left out (fig. 14, 15).

The pictures [guo2020] are no part of this project; they are read from the folder real_card of HALFANGLE_SHARED_DATA,
or of shared/data beside the checkout.
"""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.drawing.colours import display_colours, normal_colours
from analysis.evaluation.held_out import hold_out
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import Reconstruction, reconstruct
from analysis.registration.registered_pictures import import_registered
from analysis.registration.stack import Stack
from benchmarks.common.pictures import draw_row
from benchmarks.reproduction.experiment import Experiment, Finding, Request, Row, SkippedError, Verdict

Array = NDArray[np.float64]

SHARED = Path(os.environ.get("HALFANGLE_SHARED_DATA", Path(__file__).parents[4] / "shared" / "data"))

WIDTH_MM, GAMMA = 68.48, 2.2

N_PIXELS = 2000


def run(request: Request) -> Finding:
    """Reconstruct the card, and predict each photograph from the others."""
    stack = photographs(8 if request.quick else 4)
    found = reconstruct(stack, Options(light="estimate", seed=request.seed))
    rng = np.random.default_rng(request.seed)
    pixels = np.sort(rng.choice(found.depth.size, N_PIXELS, replace=False))
    left_out = hold_out(found, np.arange(stack.n_views), pixels)
    rows: list[Row] = [
        {
            "left out": view.view,
            "relative RMS": view.relative_rms,
            "Lambertian": view.lambert_relative_rms,
            "PSNR, dB": view.psnr_db,
            "Lambertian, dB": view.lambert_psnr_db,
        }
        for view in left_out
    ]
    ours, lambert = (float(np.median([row[key] for row in rows])) for key in ("relative RMS", "Lambertian"))
    offset = np.linalg.norm(found.stack.light_position - found.stack.camera_position, axis=1).mean()
    text = (
        f"photographs left out are predicted to {100 * ours:.0f} % relative RMS in the median, a Lambertian fit to "
        f"{100 * lambert:.0f} %; the torch found {offset:.1f} mm from the lens"
    )
    why = (
        "The supplement's six captures of 92 to 160 pictures are not at hand. Seven photographs with half angles to "
        "about 20 deg, 8 bits and a display gamma are far fewer, and a glittering foil has no single normal a pixel: "
        "the maps are plausible, the predictions are not ones to trust. Nobody licensed the photographs, so they stand "
        "on no page: the rendering beside the photograph that was left out is real.png in the command's folder."
    )
    _draw(stack, found, request.folder / "real.png")
    return Finding(text, Verdict.NOT_COMPARABLE, why, rows)


def photographs(binning: int) -> Stack:
    """Return the card's pictures as a stack, squares of `binning` pixels averaged.

    Raises
    ------
    SkippedError
        If they are not at hand.
    """
    folder = SHARED / "real_card"
    if not folder.is_dir():
        raise SkippedError(
            "the photographs of the card are not at hand. Name their folder's parent in HALFANGLE_SHARED_DATA"
        )
    return import_registered(folder, folder / "positions.csv", WIDTH_MM, GAMMA, binning)


def _draw(stack: Stack, found: Reconstruction, path: Path) -> None:
    view = stack.n_views - 1
    without = reconstruct(found.stack.without_view(view), Options(light="given"))
    points = found.stack.grid.points(np.nan_to_num(without.depth)).reshape(-1, 3)
    camera, light = found.stack.camera_position[view], found.stack.light_position[view]
    predicted = without.fits.radiance(points, camera, light, float(found.stack.light_power[view]))
    photograph = stack.radiance[view].astype(float)
    white = float(np.percentile(photograph, 99))
    pictures = {
        "an input": display_colours(stack.radiance[0].astype(float)),
        "normals": normal_colours(without.normals),
        "depth, mm": without.depth,
        "rendered, its photograph left out": display_colours(predicted.reshape(photograph.shape), white),
        "the photograph": display_colours(photograph, white),
    }
    draw_row(pictures, path)


EXPERIMENT = Experiment(
    "real",
    "fig. 14, 15",
    "A real capture: maps, and each photograph predicted from the others",
    "six sets of 92 to 160 images; renderings under novel light closely resemble the photographs",
    run,
)
