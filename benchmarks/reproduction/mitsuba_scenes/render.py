"""Rendering with Mitsuba 3 in a process of its own; what was rendered before is kept."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from benchmarks.reproduction.experiment import SkippedError
from benchmarks.reproduction.mitsuba_scenes.files import Rendering, write_scene
from benchmarks.reproduction.mitsuba_scenes.scenes import Scene
from benchmarks.reproduction.mitsuba_scenes.views import Placement
from instrument.files.whole_file import write_whole

JOB_FILE, LOG_FILE = "job.json", "render.log"

VARIANT = "llvm_ad_rgb"

LIBRARY_VARIABLE = "DRJIT_LIBLLVM_PATH"

# LLVM 15 and older make Mitsuba 3.9 abort.
_LLVM_VERSIONS = (21, 20, 19, 18, 17, 16)

_LIBRARIES = ("/usr/lib/x86_64-linux-gnu", "/usr/lib/aarch64-linux-gnu", "/usr/lib64", "/usr/lib", "/usr/local/lib")


class RenderError(RuntimeError):
    """Mitsuba ended without its pictures."""


def llvm_library() -> Path | None:
    """Return the LLVM library to render with: the one that the environment names, or one known to do."""
    if named := os.environ.get(LIBRARY_VARIABLE):
        return Path(named)
    folders = [Path(folder) for folder in _LIBRARIES]
    folders += [Path(f"/usr/lib/llvm-{version}/lib") for version in _LLVM_VERSIONS]
    names = [name for v in _LLVM_VERSIONS for name in (f"libLLVM-{v}.so", f"libLLVM-{v}.so.1", f"libLLVM.so.{v}.1")]
    return next((folder / name for name in names for folder in folders if (folder / name).is_file()), None)


def missing() -> str | None:
    """Return what is missing here to render, and how to have it; None if nothing is."""
    if importlib.util.find_spec("mitsuba") is None:
        return (
            "Mitsuba 3 is not installed: pip install 'halfangle[validate]', and LLVM 16 to 21 (apt install libllvm19)."
        )
    library = llvm_library()
    if library is None:
        return f"no LLVM 16 to 21 was found: apt install libllvm19, or name its library in {LIBRARY_VARIABLE}."
    if not library.is_file():
        return f"{LIBRARY_VARIABLE} names {library}, which is no file: correct or unset it."
    return None


def render(folder: Path, scene: Scene, rendering: Rendering, views: Sequence[Placement], seed: int) -> list[Path]:
    """Render views of a scene into a folder, as linear EXR of 32 bits; those that are there already are kept.

    Returns
    -------
    list of Path
        A picture of each view, in their order.

    Raises
    ------
    SkippedError
        If Mitsuba or LLVM is missing.
    RenderError
        If Mitsuba fails, with the end of what it said.
    """
    files = [folder / f"view-{i:03d}.exr" for i in range(len(views))]
    job = json.dumps(_job(rendering, views, files, seed))
    if not _is_of(folder, job):
        for path in folder.glob("view-*.exr"):
            path.unlink()
    if all(path.exists() for path in files):
        return files
    if what := missing():
        raise SkippedError(what)
    write_scene(folder, scene, rendering)
    write_whole(folder / JOB_FILE, job, overwrite=True)
    _run(folder)
    return files


def _job(rendering: Rendering, views: Sequence[Placement], files: Sequence[Path], seed: int) -> dict[str, object]:
    placed = [
        {"file": path.name, "to_world": view.to_world.tolist(), "light": view.light.tolist()}
        for path, view in zip(files, views, strict=True)
    ]
    size = [rendering.camera.width, rendering.camera.height]
    how = {"size": size, "max_depth": rendering.max_depth, "mesh_pitch_mm": rendering.mesh_pitch_mm}
    return {"samples": rendering.samples, "seed": seed, **how, "views": placed}


def _is_of(folder: Path, job: str) -> bool:
    """Tell whether the pictures in a folder are of this job, and not of another size or seed."""
    path = folder / JOB_FILE
    return path.exists() and path.read_text(encoding="utf-8") == job


def _run(folder: Path) -> None:
    environment = os.environ | {LIBRARY_VARIABLE: str(llvm_library())}
    command = [sys.executable, "-m", "benchmarks.reproduction.mitsuba_scenes.child", str(folder)]
    root = Path(__file__).parents[3]
    with (folder / LOG_FILE).open("w", encoding="utf-8") as log:
        code = subprocess.run(
            command, env=environment, cwd=root, stdout=log, stderr=subprocess.STDOUT, check=False
        ).returncode
    if code != 0:
        said = (folder / LOG_FILE).read_text(encoding="utf-8", errors="replace").strip()[-800:]
        raise RenderError(f"Mitsuba ended with {code} before all views were rendered in {folder}: {said or 'no word'}")
