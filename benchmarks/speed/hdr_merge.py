"""Error and speed of merging a bracket, beside usual ways: python -m benchmarks.speed.hdr_merge."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from analysis.radiometry.hdr import Sensor, merge_bracket, trusted_level

Array = NDArray[np.float64]

TIMES = np.array([0.001, 0.004, 0.016, 0.064, 0.256])

BLACK, SENSOR = 64.0, Sensor(saturation_level=4095.0, conversion_gain=2.5, read_noise=5.0)


@dataclass(frozen=True)
class Bracket:
    """A scene of three decades as a 12-bit camera sees it.

    Attributes
    ----------
    radiance : ndarray, shape (height, width)
        DN/s.
    counts : ndarray of uint16, shape (5, height, width)
    dark : ndarray of float32, shape (5, height, width)
    """

    radiance: Array
    counts: NDArray[np.uint16]
    dark: NDArray[np.float32]


def bracket(height: int, width: int) -> Bracket:
    """Draw a bracket: Poisson electrons, read noise, rounding, clipping."""
    rng = np.random.default_rng(0)
    radiance = 10.0 ** rng.uniform(2.7, 5.7, (height, width))
    counts = np.empty((len(TIMES), height, width), np.uint16)
    for e, t in enumerate(TIMES):
        electrons = rng.poisson(np.minimum(radiance * t, 1e4) * SENSOR.conversion_gain)
        electrons = electrons + SENSOR.read_noise * rng.standard_normal(radiance.shape)
        counts[e] = np.clip(np.round(BLACK + electrons / SENSOR.conversion_gain), 0, SENSOR.saturation_level)
    return Bracket(radiance, counts, np.full(counts.shape, BLACK, np.float32))


def least_error(scene: Bracket) -> float:
    """Return the relative RMS error that no unbiased estimate can be below (Cramer-Rao)."""
    t, L = TIMES[:, None, None], scene.radiance
    variance = L * t / SENSOR.conversion_gain + SENSOR.read_variance
    information = np.where(BLACK + L * t < trusted_level(scene.dark, SENSOR), t**2 / variance, 0.0).sum(axis=0)
    return float(np.sqrt(np.mean(1.0 / (information * L**2))))


def merged(scene: Bracket) -> Array:
    """Merge as the program does."""
    return merge_bracket(scene.counts, TIMES, scene.dark, SENSOR).mean.astype(np.float64)


def sum_over_sum(scene: Bracket) -> Array:
    """Divide the sum of the counts that did not clip by the sum of their times."""
    good = scene.counts < trusted_level(scene.dark, SENSOR)
    t = TIMES.astype(np.float32)[:, None, None]
    return np.asarray(((scene.counts - scene.dark) * good).sum(axis=0) / (t * good).sum(axis=0), np.float64)


def hat_weights(scene: Bracket) -> Array:
    """Average counts over time with weights that fall from mid-range to both ends, Debevec's [debevec1997]."""
    middle = 0.5 * (BLACK + SENSOR.saturation_level)
    weight = np.maximum(1.0 - np.abs(scene.counts - middle) / (middle - BLACK), 1e-6)
    log_radiance = np.log(np.maximum(scene.counts - scene.dark, 0.5) / TIMES[:, None, None])
    return np.asarray(np.exp((weight * log_radiance).sum(axis=0) / weight.sum(axis=0)))


def measured(name: str, merge: Callable[[Bracket], Array], scene: Bracket) -> None:
    """Write one line of the table: the best of five runs."""
    seconds = []
    for _ in range(5):
        begin = time.process_time()
        result = merge(scene)
        seconds.append(time.process_time() - begin)
    error = np.sqrt(np.mean((result / scene.radiance - 1.0) ** 2))
    sys.stdout.write(f"{name:36} {100 * error:8.3f} {error / least_error(scene):8.3f} {min(seconds):8.3f}\n")


def main() -> None:
    """Write the table."""
    scene = bracket(1200, 1920)
    sys.stdout.write(f"{'5 x 1920 x 1200, 12 bit':36} {'RMSE %':>8} {'/ least':>8} {'CPU s':>8}\n")
    measured("merge_bracket", merged, scene)
    measured("sum of counts over sum of times", sum_over_sum, scene)
    measured("hat weights (Debevec and Malik)", hat_weights, scene)


if __name__ == "__main__":
    main()
