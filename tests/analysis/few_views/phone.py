"""What a telephone makes of a sample: few views, exposed as it sees fit, 8 bits, clipped, the torch beside the lens."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis.registration.stack import Stack
from benchmarks.common.scenes import relief, scattered

OFFSET_MM, DISTANCE_MM = 12.0, 350.0


@dataclass(frozen=True)
class Phone:
    """A stack that says nothing of light and powers, and what is true of it."""

    stack: Stack
    normals: NDArray[np.float64]
    log_power: NDArray[np.float64]


def phone(size: int = 64, n_views: int = 7, seed: int = 3, *, power_error: float = 0.15) -> Phone:
    """Take pictures of a shallow relief of five materials."""
    rng = np.random.default_rng(seed)
    poses = scattered(n_views, rng, 22.0)
    scene = relief(size, n_views, 0.005, seed, table="abc", poses=poses, steepness=0.25, offset_mm=OFFSET_MM)
    power = np.exp(power_error * rng.standard_normal(n_views))
    power /= np.exp(np.log(power).mean())
    radiance = scene.stack.radiance * power[:, None, None, None].astype(np.float32)
    white = np.percentile(radiance, 98.5)
    code = np.rint(255.0 * np.clip(radiance / white, 0.0, 1.0) ** (1.0 / 2.2))
    linear = ((code / 255.0) ** 2.2).astype(np.float32)
    # In the middle of a step of the display curve, as wide as it is here, with a share of noise.
    step = 2.2 * np.maximum(code, 1.0) ** 1.2 / 255.0**2.2
    stack = replace(
        scene.stack,
        radiance=linear,
        variance=(step**2 + (0.005 * linear) ** 2).astype(np.float32),
        saturated=(code == 255).astype(np.uint8),
        light_position=scene.stack.camera_position,
        truth=None,
    )
    return Phone(stack, scene.normals, np.log(power))
