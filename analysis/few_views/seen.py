"""What views show of all pixels of a stack, and from where, as the kernels take it."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from analysis.few_views.kernels import Seen
from analysis.pixels.problem import samples_of
from analysis.registration.stack import Stack

Array = NDArray[np.float64]

Array32 = NDArray[np.float32]

Labels = NDArray[np.int64]


def gather(stack: Stack, views: Labels, log_power: Array | None = None) -> Seen:
    """Take what some views saw out of a stack, their powers corrected by the factors exp(`log_power`)."""
    samples = samples_of(stack, np.arange(stack.grid.height * stack.grid.width))
    valid = np.isfinite(samples.radiance[views])
    radiance = np.maximum(np.where(valid, samples.radiance[views], 0.0), 0.0).astype(np.float32)
    return Seen(radiance, valid.astype(np.uint8), samples.saturated[views], *directions(stack, views, log_power))


def directions(stack: Stack, views: Labels, log_power: Array | None = None) -> tuple[Array32, Array32, Array32]:
    """Return h, l and log(P / d^2) of views over the plane, shapes (V, P, 3), (V, P, 3) and (V, P)."""
    points = stack.grid.points().reshape(-1, 3)
    half = np.empty((len(views), len(points), 3), np.float32)
    light, log_gain = np.empty_like(half), np.empty(half.shape[:2], np.float32)
    for i, v in enumerate(views):
        to_light, to_camera = stack.light_position[v] - points, stack.camera_position[v] - points
        d2 = np.sum(to_light**2, axis=-1)
        omega_i = to_light / np.sqrt(d2)[:, None]
        h = omega_i + to_camera / np.linalg.norm(to_camera, axis=-1, keepdims=True)
        half[i], light[i] = h / np.linalg.norm(h, axis=-1, keepdims=True), omega_i
        log_gain[i] = np.log(stack.light_power[v] / d2) + (0.0 if log_power is None else log_power[i])
    return half, light, log_gain
