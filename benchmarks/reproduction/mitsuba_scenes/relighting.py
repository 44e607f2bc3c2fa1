"""What the result predicts for views and lights that the capture never had, beside Mitsuba's pictures of them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import OpenEXR
from numpy.typing import NDArray

from analysis.camera.view import View
from analysis.drawing.colour_difference import ciede2000, lab_from_srgb
from analysis.drawing.colours import display_colours
from analysis.evaluation.metrics import psnr_db
from analysis.registration.rectification import rectify
from analysis.registration.stack import Stack
from analysis.results.result import Result
from benchmarks.reproduction.mitsuba_scenes.prepared import Prepared
from benchmarks.reproduction.mitsuba_scenes.views import Camera, Placement, captured, novel

Array = NDArray[np.float64]


@dataclass(frozen=True)
class Relit:
    """A novel view on the grid of the area, as display colours 0 to 1.

    Attributes
    ----------
    ours, truth : ndarray, shape (H, W, 3)
        Both with the white of the truth's 99th percentile, by the sRGB curve.
    """

    ours: Array
    truth: Array

    @property
    def psnr_db(self) -> float:
        """Of the display colours, whose peak is 1."""
        return psnr_db(self.ours, self.truth, 1.0)

    @property
    def delta_e(self) -> float:
        """Mean CIEDE2000."""
        return float(np.mean(ciede2000(lab_from_srgb(self.ours), lab_from_srgb(self.truth))))


def relit(prepared: Prepared, result: Result) -> list[Relit]:
    """Return the novel views of a scene, ours beside Mitsuba's."""
    camera = prepared.rendering.camera
    points = result.grid.points(result.depth)
    unit, power = _unit(prepared), _power(prepared.stack)
    pairs = []
    for path, placement in zip(prepared.novel, novel(), strict=True):
        truth = on_grid(path, placement, camera, points, result.grid.pitch) / unit
        ours = result.render(placement.camera, placement.light, power)
        white = float(np.nanpercentile(truth, 99))
        pairs.append(Relit(display_colours(ours, white), display_colours(truth, white)))
    return pairs


def on_grid(path: Path, placement: Placement, camera: Camera, points: Array, pitch: float) -> Array:
    """Return a rendered picture at points of the sample, shape (H, W, 3), linear."""
    picture = read_linear(path)
    nothing = np.zeros_like(picture)
    view: View = placement.view(camera)
    return np.asarray(rectify(picture, nothing, nothing > 0, "", view, points, pitch).radiance, np.float64)


def read_linear(path: Path) -> NDArray[np.float32]:
    """Return a rendered picture, shape (height, width, 3)."""
    with OpenEXR.File(str(path)) as file:
        return np.ascontiguousarray(file.channels()["RGB"].pixels, np.float32)


def _unit(prepared: Prepared) -> Array:
    """Return Mitsuba's radiance that the stack counts as 1, per channel: of the view from straight above."""
    stack = prepared.stack
    rendered = on_grid(
        prepared.captured[0], captured()[0], prepared.rendering.camera, stack.grid.points(), stack.pixel_pitch
    )
    ratio = rendered / np.asarray(stack.radiance[0], np.float64)
    return np.asarray(np.nanmedian(ratio.reshape(-1, ratio.shape[-1]), axis=0))


def _power(stack: Stack) -> float:
    """Return the lamp's power in the stack's units: what lights white paper as the stack says, from where it stood."""
    light = np.array([placement.light for placement in captured()])
    found, true = (p[:, 2] / np.linalg.norm(p, axis=1) ** 3 for p in (stack.light_position, light))
    return float(np.nanmedian(stack.light_power * found / true))
