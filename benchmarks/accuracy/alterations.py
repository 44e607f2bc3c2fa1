"""What can go wrong with a capture, done to a scene after it was made, and what a method may choose not to see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from analysis.registration.stack import Stack
from benchmarks.common.scenes import Scene


def clipped(scene: Scene, times_median: float) -> Scene:
    """Clip radiances at so many times the median, and mark them as saturated."""
    radiance = scene.stack.radiance
    level = np.float32(times_median * np.median(radiance))
    saturated = (radiance > level).astype(np.uint8)
    return _with(scene, replace(scene.stack, radiance=np.minimum(radiance, level), saturated=saturated))


def spoilt(scene: Scene, share: float, rng: np.random.Generator) -> Scene:
    """Make a share of the samples wrong as `scenes.relief` does: a tenth, or two to five times as bright."""
    radiance = scene.stack.radiance
    bad = rng.random(radiance.shape[:3]) < share
    factor = np.where(rng.random(bad.shape) < 0.5, 0.1, rng.uniform(2.0, 5.0, bad.shape))
    wrong = np.where(bad[..., None], radiance * factor[..., None], radiance).astype(np.float32)
    return _with(scene, replace(scene.stack, radiance=wrong))


def with_gain_errors(scene: Scene, sigma: float, rng: np.random.Generator) -> Scene:
    """Change the light's power from view to view, by `sigma` (relative), without telling the stack."""
    stack = scene.stack
    gain = (1.0 + sigma * rng.standard_normal(stack.n_views)).astype(np.float32)
    return _with(scene, replace(stack, radiance=stack.radiance * gain[:, None, None, None]))


def at_wrong_distance(scene: Scene, factor: float) -> Scene:
    """State that camera and light stood `factor` times as far away as they did."""
    stack = scene.stack
    positions = {name: factor * getattr(stack, name) for name in ("camera_position", "light_position")}
    return _with(scene, replace(stack, **positions))


def without_offset(scene: Scene) -> Scene:
    """Take the light for collocated with the lens."""
    return _with(scene, replace(scene.stack, light_position=scene.stack.camera_position))


def without_variance(scene: Scene) -> Scene:
    """Withhold the variance of the radiances."""
    return _with(scene, replace(scene.stack, variance=None))


def _with(scene: Scene, stack: Stack) -> Scene:
    return replace(scene, stack=stack)
