"""Rendered pictures through the product's own doors: import, calibrate, reconstruct; nothing of the truth goes in."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from analysis.calibration.register import register
from analysis.pipeline import reconstruct
from analysis.reconstruction.options import Accuracy, Options
from analysis.registration.stack import Stack
from analysis.registration.stack_file import read_stack
from analysis.results.result import Result
from analysis.results.result_file import read_result, write_result
from benchmarks.reproduction.mitsuba_scenes.plate import AREA_MM, boards
from benchmarks.reproduction.mitsuba_scenes.views import DISTANCE_MM, LIGHT_BY_RULER_MM, LIGHT_SIGMA_MM, Camera
from instrument.files.whole_file import write_whole
from instrument.imports.prepare import CAPTURE_FILE, prepare_import
from instrument.imports.writing import write_import
from instrument.session.records import Board
from instrument.session.session import Session

Array = NDArray[np.float64]

SESSION_FILE, STACK_FILE = "session.h5", "area.stack.h5"


@dataclass(frozen=True)
class Chain:
    """The files of one scene.

    Attributes
    ----------
    folder : Path
        Where session, stack and results are put; a step whose file is there is not done again.
    """

    folder: Path

    def is_finished(self, accuracy: Accuracy) -> bool:
        """Tell whether there is a result already."""
        return self._result_file(accuracy).exists()

    def stack(self, pictures: Path, camera: Camera, n_views: int, pitch: float | None = None) -> Stack:
        """Return the registered stack of the first `n_views` pictures in a folder, with pixels of `pitch` mm."""
        self.folder.mkdir(parents=True, exist_ok=True)
        session = self._made(SESSION_FILE, lambda path: _import(pictures, path, camera, n_views, pitch))
        return read_stack(self._made(STACK_FILE, lambda path: _register(session, path)))

    def result(self, stack: Stack, accuracy: Accuracy) -> Result:
        """Return what a stack says of its sample, with so many updates of the geometry."""
        return read_result(
            self._made(self._result_file(accuracy).name, lambda path: _reconstruct(stack, path, accuracy))
        )

    def _result_file(self, accuracy: Accuracy) -> Path:
        return self.folder / f"{accuracy}.result.h5"

    def _made(self, name: str, make: Callable[[Path], None]) -> Path:
        path = self.folder / name
        if not path.exists():
            make(path)
        return path


def _import(pictures: Path, path: Path, camera: Camera, n_views: int, pitch: float | None) -> None:
    capture = path.with_name(CAPTURE_FILE)
    write_whole(capture, capture_text(camera, n_views, pitch), overwrite=True)
    write_import(prepare_import(pictures, capture), path)


def _register(session: Path, path: Path) -> None:
    with Session(session) as opened:
        register(opened, path)


def _reconstruct(stack: Stack, path: Path, accuracy: Accuracy) -> None:
    write_result(path, reconstruct(stack, Options(accuracy=accuracy), n_held_out=0))


def capture_text(camera: Camera, n_views: int, pitch: float | None = None) -> str:
    """Return the `capture.toml` of what someone with a ruler knows: boards, area, distance, nominal lens, light."""
    head = f"""name = "rendered by Mitsuba"
linear = true
focal_length_px = {round(camera.focal_length_px, -1)}
working_distance_mm = {DISTANCE_MM}

[light]
offset_mm = {list(LIGHT_BY_RULER_MM)}
offset_sigma_mm = {LIGHT_SIGMA_MM}

[area]
width_mm = {AREA_MM}
height_mm = {AREA_MM}
{"" if pitch is None else f"pitch_mm = {pitch}"}
"""
    poses = [f'[[poses]]\nfiles = ["view-{i:03d}.exr"]\nexposure_times_s = [1.0]\n' for i in range(n_views)]
    return "\n".join([head, *map(_board_text, boards()), *poses])


def _board_text(board: Board) -> str:
    return f"""[[boards]]
kind = "{board.kind}"
dictionary = "{board.dictionary}"
first_id = {board.first_id}
squares = {list(board.squares)}
square_mm = {board.square_mm}
marker_mm = {board.marker_mm}
corner_mm = {list(board.corner_mm)}
"""
