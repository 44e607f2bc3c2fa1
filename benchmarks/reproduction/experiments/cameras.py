"""One relief through two cameras: a laboratory camera that brackets, and a phone with one exposure (fig. 16).

Both see the same radiances. What differs is what they make of them: full well, read noise, bits, and whether a
highlight that clips in one exposure is there in another.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from analysis.drawing.colours import display_colours, normal_colours
from analysis.evaluation.metrics import angular_error_deg
from analysis.reconstruction.reconstruction import reconstruct
from analysis.registration.stack import Stack
from benchmarks.common.scenes import Scene, relief
from benchmarks.reproduction.experiment import Experiment, Finding, Request, Row, Verdict
from instrument.files.whole_file import written_whole

Array = NDArray[np.float64]

N_VIEWS = 65

VISIBLE_DEG = float(np.rad2deg(2.0 / 255.0))
"""What a normal turns by when a false colour (n + 1) / 2 changes by one step of 8 bits: less shows in no map."""


@dataclass(frozen=True)
class Sensor:
    """A camera, as far as its noise goes.

    Attributes
    ----------
    name : str
    full_well : float
        Electrons at which a pixel clips.
    read_noise : float
        Electrons.
    bit_depth : int
    exposures : tuple of float
        Exposure times of its bracket, in units of the one whose 99th percentile just does not clip.
    """

    name: str
    full_well: float
    read_noise: float
    bit_depth: int
    exposures: tuple[float, ...]


# Pixel pitches of 5.86 and 1.22 um make full wells of about 32000 and 4500 electrons.
LABORATORY = Sensor("laboratory, bracketed", 32000.0, 7.0, 12, (0.05, 0.25, 1.0, 4.0))

PHONE = Sensor("phone, one exposure", 4500.0, 2.5, 10, (0.7,))


def run(request: Request) -> Finding:
    """Reconstruct what both cameras saw and compare the normals."""
    size = 48 if request.quick else 160
    scene = relief(size, N_VIEWS, 0.0, request.seed, floor=0.0)
    rows, normals = [], []
    for number, sensor in enumerate((LABORATORY, PHONE)):
        seen = through(scene, sensor, np.random.default_rng((request.seed, number)))
        found = reconstruct(seen).normals
        normals.append(found)
        rows.append(_row(sensor, seen, scene, found))
    laboratory, phone = rows
    errors = [row["mean, deg"] for row in rows]
    ours = (
        f"mean angular error {errors[0]:.3f} deg with the laboratory camera, {errors[1]:.3f} deg with the phone; "
        f"median {laboratory['median, deg']:.3f} and {phone['median, deg']:.3f} deg"
    )
    alike = errors[1] < VISIBLE_DEG
    less = "less" if alike else "more"
    why = (
        "The supplement shows normals of one real sample without a truth. Here the phone's error is "
        f"{errors[1] / errors[0]:.1f} times the laboratory camera's, and {less} than the {VISIBLE_DEG:.2f} deg that "
        f"one step of a false colour is. {100 * phone['clipped']:.1f} % of its samples clip, "
        f"{100 * laboratory['clipped']:.2f} % of the other's in every exposure. Only the sensor of a phone is "
        "simulated: not its tone curve and sharpening, nor the hand that holds it."
    )
    figure = _figure(scene, normals, rows, request.folder / "cameras.png")
    return Finding(ours, Verdict.EQUAL if alike else Verdict.WORSE, why, rows, [figure])


def through(scene: Scene, sensor: Sensor, rng: np.random.Generator) -> Stack:
    """Return the scene's stack as a sensor sees it: exposures merged, each weighted by its variance."""
    # Flux falls on every sample as its radiance says; the light is as bright as the sensor can just take.
    flux = scene.stack.radiance.astype(float) / np.percentile(scene.stack.radiance, 99.0) * sensor.full_well
    step = sensor.full_well / (2**sensor.bit_depth - 1)  # electrons per count
    total, weight = np.zeros(flux.shape), np.zeros(flux.shape)
    clips = np.ones(flux.shape, bool)
    for exposure in sensor.exposures:
        electrons = rng.poisson(flux * exposure) + sensor.read_noise * rng.standard_normal(flux.shape)
        counts = np.round(electrons / step)
        clipped = counts >= 2**sensor.bit_depth - 1
        variance = (np.maximum(electrons, 0.0) + sensor.read_noise**2 + step**2 / 12.0) / exposure**2
        w = np.where(clipped, 0.0, 1.0 / variance)
        total, weight, clips = total + w * counts * step / exposure, weight + w, clips & clipped
    # What clips even in the shortest exposure is at least that bright.
    level = sensor.full_well / min(sensor.exposures)
    merged = np.where(clips, level, total / np.where(clips, 1.0, weight))
    variance = np.where(clips, level**2, 1.0 / np.where(clips, 1.0, weight))
    scale = np.percentile(scene.stack.radiance, 99.0) / sensor.full_well
    return replace(
        scene.stack,
        radiance=(merged * scale).astype(np.float32),
        variance=(variance * scale**2).astype(np.float32),
        saturated=clips.astype(np.uint8),
    )


def _row(sensor: Sensor, stack: Stack, scene: Scene, normals: Array) -> Row:
    error = angular_error_deg(normals.reshape(-1, 3), scene.normals)
    solved = np.isfinite(error)
    mean, median, high = float(error[solved].mean()), *(float(q) for q in np.percentile(error[solved], [50, 95]))
    assert stack.saturated is not None
    return {
        "camera": sensor.name,
        "mean, deg": mean,
        "median, deg": median,
        "95 %, deg": high,
        "solved": float(solved.mean()),
        "clipped": float(stack.saturated.mean()),
    }


def _figure(scene: Scene, normals: list[Array], rows: list[Row], path: Path) -> Path:
    figure = Figure(figsize=(11, 2.9), layout="constrained")
    axes = figure.subplots(1, 5)
    shape = (scene.stack.grid.height, scene.stack.grid.width)
    pictures = [("a view", display_colours(scene.stack.radiance[0])), ("true normals", _coloured(scene.normals, shape))]
    pictures += [(row["camera"], normal_colours(found)) for row, found in zip(rows, normals, strict=True)]
    for ax, (title, colours) in zip(axes, pictures, strict=False):
        ax.imshow(colours, interpolation="nearest")
        ax.set_title(title, fontsize=9)
    error = angular_error_deg(normals[1].reshape(-1, 3), scene.normals).reshape(shape)
    shown = axes[4].imshow(error, vmin=0.0, vmax=max(1.0, float(np.nanpercentile(error, 95))))
    axes[4].set_title("error of the phone, deg", fontsize=9)
    figure.colorbar(shown, ax=axes[4], shrink=0.8)
    for ax in axes:
        ax.set_axis_off()
    with written_whole(path, overwrite=True) as part:
        figure.savefig(part, dpi=80, format="png")
    return path


def _coloured(normals: Array, shape: tuple[int, int]) -> Array:
    return normal_colours(normals.reshape(*shape, 3))


EXPERIMENT = Experiment(
    "cameras",
    "fig. 16",
    "Normals of one relief through a laboratory camera with a bracket and a phone without",
    "nearly the same quality with the phone as with the laboratory camera",
    run,
)
