"""Speed and error of the integration on a smooth surface: python -m benchmarks.speed.integration."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray

from analysis.depth.integration import integrate_normals
from analysis.depth.uncertainty import depth_sigma
from analysis.evaluation.metrics import depth_rmse

Array = NDArray[np.float64]

PITCH = 0.05


def waves(height: int, width: int) -> tuple[Array, Array]:
    """Return depth in mm, and normals, of waves of 0.8 and 6 mm."""
    x, y = np.arange(width) * PITCH, -np.arange(height)[:, None] * PITCH
    z, p, q = np.zeros((height, width)), np.zeros((height, width)), np.zeros((height, width))
    for amplitude, k in ((0.02, 2.0 * np.pi / 0.8), (0.5, 2.0 * np.pi / 6.0)):
        z += amplitude * np.sin(k * x) * np.cos(k * y)
        p += amplitude * k * np.cos(k * x) * np.cos(k * y)
        q -= amplitude * k * np.sin(k * x) * np.sin(k * y)
    normals = np.stack([-p, -q, np.ones_like(p)], axis=-1)
    return z, normals / np.linalg.norm(normals, axis=-1, keepdims=True)


def fastest_seconds(size: int = 2000) -> float:
    """Return the seconds that the normals of `size` by `size` pixels take to become depth, the best of five times."""
    normals = waves(size, size)[1]
    seconds = []
    for _ in range(5):
        begin = time.perf_counter()
        integrate_normals(normals, PITCH)
        seconds.append(time.perf_counter() - begin)
    return min(seconds)


def with_holes(normals: Array) -> Array:
    """Leave out a twentieth of the pixels, and a block."""
    holed = normals.copy()
    height, width = normals.shape[:2]
    holed[np.random.default_rng(0).random((height, width)) < 0.05] = np.nan
    holed[height // 4 : height // 2, width // 3 : width // 2] = np.nan
    return holed


def patchy_sigma(height: int, width: int) -> Array:
    """Return sigmas from 0.001 to 0.1 rad in patches of 20 pixels."""
    patches = 10.0 ** np.random.default_rng(0).uniform(-3.0, -1.0, (height // 20 + 1, width // 20 + 1))
    return np.asarray(np.kron(patches, np.ones((20, 20)))[:height, :width], np.float64)


def measured(name: str, run: Callable[[], Array], truth: Array | None) -> None:
    """Write one line of the table: the best of three runs, or of as many as fit into three seconds."""
    wall, processor, begun = np.inf, np.inf, time.perf_counter()
    for _ in range(3):
        clocks = time.perf_counter(), time.process_time()
        result = run()
        wall = min(wall, time.perf_counter() - clocks[0])
        processor = min(processor, time.process_time() - clocks[1])
        if time.perf_counter() - begun > 3.0:
            break
    error = "" if truth is None else f"{1e3 * depth_rmse(result, truth):9.3f}"
    size = f"{result.shape[0]} x {result.shape[1]}"
    speed = 1e-6 * result.size / wall
    sys.stdout.write(f"{size:12} {name:32} {wall:8.3f} {processor:8.3f} {speed:8.2f} {error}\n")


def main() -> None:
    """Write the table."""
    sys.stdout.write(f"{'size':12} {'method':32} {'s':>8} {'CPU s':>8} {'Mpixel/s':>8} {'um RMS':>9}\n")
    integrate_normals(with_holes(waves(40, 40)[1]), PITCH)  # compiles
    integrate_normals(waves(40, 40)[1], PITCH)
    for shape in ((1000, 1000), (2000, 2000), (1999, 2003)):
        truth, normals = waves(*shape)
        measured("cosine transform", partial(integrate_normals, normals, PITCH), truth)
    truth, normals = waves(1000, 1000)
    holed, sigma = with_holes(normals), patchy_sigma(1000, 1000)
    for tolerance in (1e-5, 1e-6):
        measured(f"holes, tolerance {tolerance:g}", partial(integrate_normals, holed, PITCH, tolerance), truth)
    measured("patchy sigmas", lambda: integrate_normals(normals, PITCH, 1e-5, sigma=sigma), truth)
    truth, normals = waves(300, 300)
    rng = np.random.default_rng(0)
    measured("depth_sigma", lambda: depth_sigma(np.full((2000, 2000), 0.01), PITCH, rng), None)
    measured("depth_sigma, weighted", lambda: depth_sigma(sigma, PITCH, rng, weighted=True), None)


if __name__ == "__main__":
    main()
