"""Renders the views of a job with Mitsuba 3, in a process of its own.

    python -m benchmarks.reproduction.mitsuba_scenes.child FOLDER

Mitsuba ends the whole process where it meets an LLVM that it cannot use, so nothing else may live in it.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import mitsuba as mi
import numpy as np

from benchmarks.reproduction.mitsuba_scenes.files import SCENE_FILE
from benchmarks.reproduction.mitsuba_scenes.render import JOB_FILE, VARIANT
from instrument.files.whole_file import written_whole

_SAMPLES_AT_ONCE = 16  # bounds the memory; passes have seeds of their own


def main(folder: Path) -> None:
    """Render the views that are not there yet."""
    mi.set_variant(VARIANT)
    job = json.loads((folder / JOB_FILE).read_text(encoding="utf-8"))
    scene = mi.load_file(str(folder / SCENE_FILE))
    parameters = mi.traverse(scene)
    for number, view in enumerate(job["views"]):
        path = folder / view["file"]
        if path.exists():
            continue
        parameters["camera.to_world"] = mi.Transform4f(np.array(view["to_world"]))
        parameters["lamp.position"] = mi.Point3f(view["light"])
        parameters.update()
        picture = mi.Bitmap(_mean(scene, job["samples"], job["seed"] + 100 * number))
        with written_whole(path) as part:
            # Mitsuba asks the name for the format unless it is told.
            picture.write(str(part), mi.Bitmap.FileFormat.OpenEXR)


def _mean(scene: Any, samples: int, seed: int) -> Any:
    """Return the mean of enough passes, shape (height, width, 3), float32."""
    n_passes = -(-samples // _SAMPLES_AT_ONCE)
    spp = -(-samples // n_passes)
    pictures = (np.array(mi.render(scene, spp=spp, seed=mi.UInt32(seed + k)), np.float32) for k in range(n_passes))
    return sum(pictures) / np.float32(n_passes)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
