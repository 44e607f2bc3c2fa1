"""What the experiments on rendered scenes share: the size of a run, its pictures, its stack, its truth."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from analysis.reconstruction.options import Accuracy
from analysis.registration.grid import Grid
from analysis.registration.stack import Stack, Truth
from analysis.results.result import Result
from benchmarks.reproduction.experiment import Request
from benchmarks.reproduction.mitsuba_scenes.chain import Chain
from benchmarks.reproduction.mitsuba_scenes.files import Rendering
from benchmarks.reproduction.mitsuba_scenes.render import render
from benchmarks.reproduction.mitsuba_scenes.scenes import SCENES, Scene
from benchmarks.reproduction.mitsuba_scenes.views import Camera, captured, novel

Array = NDArray[np.float64]

FINAL: Accuracy = "normal"
"""How the reconstruction runs unless someone says otherwise: at most two updates of the geometry."""

PICTURE_BLUR = 0.6
"""Standard deviation of what a resampled picture averages over at the least, in its pixels; most views see them
foreshortened."""

_FINER = 5  # odd, so that pixels have a centre


@dataclass(frozen=True)
class Size:
    """How large a run is.

    Attributes
    ----------
    scenes : tuple of Scene
    rendering : Rendering
    pitch_mm : float or None
        Of the maps; None = as fine as the pictures.
    accuracies : tuple of Accuracy
        Budgets of the reconstruction, ascending.
    """

    scenes: tuple[Scene, ...]
    rendering: Rendering
    pitch_mm: float | None
    accuracies: tuple[Accuracy, ...]


QUICK = Size(SCENES[:1], Rendering(Camera(640, 480), samples=8), 0.5, (FINAL,))

FULL = Size(SCENES, Rendering(Camera(800, 600), samples=32), None, ("draft", FINAL))


@dataclass(frozen=True)
class Prepared:
    """A scene as it was rendered and registered.

    Attributes
    ----------
    scene : Scene
    rendering : Rendering
    captured, novel : list of Path
        Pictures, linear.
    chain : Chain
    stack : Stack
    """

    scene: Scene
    rendering: Rendering
    captured: list[Path]
    novel: list[Path]
    chain: Chain
    stack: Stack

    @property
    def truth(self) -> Truth:
        """What is true of the stack's pixels."""
        return truth_on(self.scene, self.stack.grid)

    def result(self, accuracy: Accuracy = FINAL) -> Result:
        """Return the reconstruction."""
        return self.chain.result(self.stack, accuracy)


def size_of(request: Request) -> Size:
    """Return the size that a request asks for."""
    return QUICK if request.quick else FULL


def prepared(request: Request, scene: Scene) -> Prepared:
    """Render a scene and register it, or take up what a run of the same request left.

    Raises
    ------
    SkippedError
        If Mitsuba is missing.
    """
    size, views = size_of(request), captured()
    folder = _folder(request, scene)
    files = render(folder, scene, size.rendering, [*views, *novel()], request.seed)
    chain = Chain(folder)
    stack = chain.stack(folder, size.rendering.camera, len(views), size.pitch_mm)
    return Prepared(scene, size.rendering, files[: len(views)], files[len(views) :], chain, stack)


def truth_as_seen(scene: Scene, grid: Grid, camera: Camera) -> Array:
    """Return normals averaged over what a pixel of the maps sees, shape (H, W, 3): itself, or the picture's blur."""
    fine = Grid(grid.height * _FINER, grid.width * _FINER, grid.pitch / _FINER)
    sigma_mm = max(grid.pitch / np.sqrt(12.0), PICTURE_BLUR * camera.pixel_mm)
    normals = gaussian_filter(truth_on(scene, fine).normals, sigma_mm / fine.pitch, axes=(0, 1), mode="nearest")
    centres = normals[_FINER // 2 :: _FINER, _FINER // 2 :: _FINER]
    return np.asarray(centres / np.linalg.norm(centres, axis=-1, keepdims=True))


def truth_on(scene: Scene, grid: Grid) -> Truth:
    """Return normals and depth of a scene's surface at the centres of a grid's pixels."""
    points = grid.points()
    x, y = points[..., 0], points[..., 1]
    return Truth(scene.surface.normals(x, y), scene.surface.height(x, y))


def _folder(request: Request, scene: Scene) -> Path:
    """Return the folder of a scene: beside this experiment's where another has finished it, else in this one's."""
    name = Path(f"{'quick' if request.quick else 'full'}-{request.seed}") / scene.name
    finished = request.folder.parent / "synthetic" / name
    return finished if Chain(finished).is_finished(FINAL) else request.folder / name
