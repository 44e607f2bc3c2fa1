"""What must hold exactly: no figure, but yes or no."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from analysis.pixels.identifiability import view_problems
from analysis.pixels.problem import PixelProblem
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import reconstruct
from analysis.reflectance.dictionary import parametric
from benchmarks.common.methods import KNOWN_NOISE
from benchmarks.common.scenes import FAR_MM, Scene, independent, relief


@dataclass(frozen=True)
class Check:
    """One thing that must hold.

    Attributes
    ----------
    name : str
    passed : bool
    what : str
        What was seen.
    """

    name: str
    passed: bool
    what: str


def checks(seed: int) -> Iterator[Check]:
    """Yield all checks."""
    scene = independent(600, 25, 0.02, seed)
    yield from _refused_poses(scene)
    yield _same_bits(scene)
    yield _same_bits_whole(seed)


def _refused_poses(scene: Scene) -> Iterator[Check]:
    """Ask whether poses that cannot determine normals are refused."""
    azimuth = np.linspace(0.0, 2.0 * np.pi, scene.stack.n_views, endpoint=False)
    tilt = np.linspace(-1.0, 1.0, scene.stack.n_views)
    flat, cone = np.zeros_like(azimuth), np.full_like(azimuth, 0.5)
    for name, theta, phi in (("poses in one plane", tilt, flat), ("poses on one cone", cone, azimuth)):
        omega = np.stack([np.sin(theta) * np.cos(phi), np.sin(theta) * np.sin(phi), np.cos(theta)], axis=1)
        stack = replace(scene.stack, camera_position=FAR_MM * omega, light_position=FAR_MM * omega)
        found = [problem.what for problem in view_problems(stack)]
        yield Check(f"{name} are refused", bool(found), found[0] if found else "they were accepted")


def _same_bits_whole(seed: int) -> Check:
    """Reconstruct a relief, palette and all, with one thread and with two."""
    stack = relief(48, 25, 0.02, seed).stack
    one, two = (reconstruct(stack, Options(palette="on", threads=n)) for n in (1, 2))
    same = np.array_equal(one.normals, two.normals, equal_nan=True) and np.array_equal(one.depth, two.depth)
    largest = float(np.nanmax(np.abs(one.normals - two.normals)))
    name = "one and two threads give the same bits of a whole reconstruction"
    return Check(name, bool(same), f"largest difference {largest:.1e}")


def _same_bits(scene: Scene) -> Check:
    """Solve with one thread and with two."""
    problem = PixelProblem(scene.stack, parametric())
    one, two = (problem.solve(KNOWN_NOISE, threads=n).normals for n in (1, 2))
    largest = float(np.nanmax(np.abs(one - two)))
    same = bool(np.array_equal(one, two, equal_nan=True))
    return Check("one and two threads give the same bits", same, f"largest difference {largest:.1e}")
