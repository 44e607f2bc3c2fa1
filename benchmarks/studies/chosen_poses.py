"""Do 25 chosen views what 65 on a grid do? python -m benchmarks.studies.chosen_poses.

Every sample is seen at the 65 poses of examples/hdr_sweep.toml, at 25 poses on rings and at the 25 poses of
examples/chosen_poses.toml, and reconstructed with the program's own choices; the 25 with the same exposures a pose,
and with the same light in all, which the time saved on motion pays for. First as stacks with known geometry and
noise: reliefs of measured materials, none of which is the rough one that the choice assumes, and the simulated
samples at the rig's true positions. Then by the whole chain on the simulated rig: capture, calibration, reconstruction.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import click
import numpy as np

from analysis.evaluation.metrics import angular_error_deg, error_summary
from analysis.pipeline import calibrate
from analysis.pixels.fits import PixelFits
from analysis.reconstruction.reconstruction import Reconstruction, reconstruct
from analysis.reflectance.models import Array, Cosines
from analysis.registration.grid import Grid
from analysis.registration.stack import Stack, Truth
from analysis.registration.stack_file import read_stack, write_truth
from benchmarks.common.scenes import DARK_FLOOR, Scene, relief, with_noise
from benchmarks.common.simulated import EXAMPLES, truth_of
from drivers.simulated.rendering.brdf import evaluate
from drivers.simulated.stage import SimulatedStage
from drivers.simulated.world import World
from drivers.stage import AxisDescription
from instrument.config.loading import load_protocol, load_rig
from instrument.config.protocol import BracketConfig, PoseConfig, ProtocolConfig
from instrument.config.rig import RigConfig
from protocols.capture.engine import capture
from protocols.planning.plan import Plan
from protocols.poses.choice import choose_poses
from protocols.poses.nominal_geometry import lens_and_light

Poses = tuple[dict[str, float], ...]

SIZE, NOISE = 40, 0.01

CHAIN_PITCH_MM = 0.5

THETA_H = np.deg2rad(np.linspace(3.0, 55.0, 14))
"""Half angles at which curves are judged, the same whatever was seen."""

SAME_LIGHT_S = (0.002, 0.004, 0.01, 0.02, 0.05, 0.075)
"""Exposures at 25 poses that sum up to those of the sweep's three at 65."""

RINGS = ((0.0, 1), (20.0, 7), (35.0, 8), (50.0, 9))
"""Tilt and number of the 25 poses on rings, to the tilt of the grid."""


@dataclass(frozen=True)
class Views:
    """Poses, and how much light is spent on each.

    Attributes
    ----------
    name : str
    poses : tuple of dict
        Positions by axis.
    exposure_times : tuple of float
        Seconds, at each pose.
    noise : float
        One sigma of a radiance in a stack, relative.
    """

    name: str
    poses: Poses
    exposure_times: tuple[float, ...]
    noise: float = NOISE


@dataclass(frozen=True)
class Sample:
    """A sample that can be seen from any poses.

    Attributes
    ----------
    name : str
    stack : callable
        From views to a registered stack with its truth.
    curve : ndarray, shape (P, T, 3)
        True BRDF on the slice at `THETA_H`, 1/sr.
    """

    name: str
    stack: Callable[[Views], Stack]
    curve: Array


@dataclass(frozen=True)
class Figures:
    """What came of one sample seen from one set of poses.

    Attributes
    ----------
    mean, median, p95 : float
        Error of the normals, degrees.
    curve : float
        Median over the pixels of the RMS of fitted over true BRDF less 1.
    seconds : float
    """

    mean: float
    median: float
    p95: float
    curve: float
    seconds: float


def all_views(rig: RigConfig) -> tuple[Views, ...]:
    """Return what is compared."""
    sweep, config = load_protocol(EXAMPLES / "hdr_sweep.toml"), load_protocol(EXAMPLES / "chosen_poses.toml").chosen
    assert config is not None
    plan = Plan.from_protocol(sweep)
    times = plan.exposure_times
    grid = tuple(plan.target(i) for i in range(plan.n_poses))
    rings = tuple({"tilt": t, "turn": (360.0 * i / n + t) % 360.0} for t, n in RINGS for i in range(n))
    chosen = choose_poses(rig, stage_axes(rig), config)
    less_noise = NOISE * (len(chosen) / len(grid)) ** 0.5
    return (
        Views(f"{len(grid)} on a grid", grid, times),
        Views("25 on rings", rings, times),
        Views("25 chosen", chosen, times),
        Views("25 on rings, same light", rings, SAME_LIGHT_S, less_noise),
        Views("25 chosen, same light", chosen, SAME_LIGHT_S, less_noise),
    )


def stage_axes(rig: RigConfig) -> tuple[AxisDescription, ...]:
    """Return the axes of the simulated stage."""
    stage = SimulatedStage(world_of(rig))
    stage.connect()
    return stage.describe().axes


def world_of(rig: RigConfig) -> World:
    """Return the world of a simulated rig."""
    return World.from_rig(rig.model_dump(exclude_none=True))


def samples(rig: RigConfig, seed: int, n_reliefs: int) -> Iterator[Sample]:
    """Yield reliefs of measured materials, then the samples of the simulated rig."""
    for i in range(n_reliefs):
        yield measured_relief(rig, seed + i, ("sgd", "abc")[i % 2])
    for name in ("relief", "sphere_cap"):
        yield simulated_sample(rig, name, seed)


def measured_relief(rig: RigConfig, seed: int, table: str) -> Sample:
    """Return a relief of five materials drawn from a published table."""
    axes = stage_axes(rig)

    def scene(views: Views) -> Scene:
        lens, _ = lens_and_light(rig, axes, views.poses)
        directions = lens / np.linalg.norm(lens, axis=1, keepdims=True)
        floor = DARK_FLOOR * views.noise / NOISE
        return relief(SIZE, len(directions), views.noise, seed, table=table, poses=directions, floor=floor)

    curve = scene(Views("facing", ({"tilt": 0.0, "turn": 0.0},), ())).curve(half_angles())
    return Sample(f"relief of {table}, seed {seed}", lambda views: scene(views).stack, curve)


def half_angles() -> Array:
    """Return `THETA_H` for each pixel, shape (P, T)."""
    return np.broadcast_to(THETA_H, (SIZE * SIZE, len(THETA_H)))


def simulated_sample(rig: RigConfig, name: str, seed: int) -> Sample:
    """Return a sample of the simulated rig; the seed moves its errors and the noise."""
    simulation = rig.simulation.model_copy(update={"scene": name, "seed": seed})
    world = world_of(rig.model_copy(update={"simulation": simulation}))
    grid = Grid(SIZE, SIZE, rig.geometry.area_mm[0] / SIZE)
    return Sample(f"simulated {name}, seed {seed}", lambda views: _seen(world, grid, views), _curves(world, grid))


def _seen(world: World, grid: Grid, views: Views) -> Stack:
    """Return a stack at the true positions; shadows are dark, what the lens does not see is missing."""
    poses, (x, y) = views.poses, np.moveaxis(grid.points()[..., :2], -1, 0)
    lens = np.stack([world.camera_in_sample(pose) for pose in poses])
    light = np.stack([world.light_in_sample(pose) for pose in poses])
    radiance = [
        np.where(world.sees(x, y, b)[..., None], world.radiance_on_area(x, y, a, b), 0.0)
        for a, b in zip(lens, light, strict=True)
    ]
    seen = np.stack([world.sees(x, y, a) for a in lens])[..., None]
    rng, floor = np.random.default_rng(world.bench.simulation.seed), DARK_FLOOR * views.noise / NOISE
    noisy, variance = with_noise(np.stack(radiance), views.noise, rng, floor)
    truth = world.truth(x, y)
    return Stack(
        radiance=np.where(seen, noisy, np.float32(np.nan)),
        variance=variance,
        camera_position=lens,
        light_position=light,
        light_power=np.ones(len(poses)),
        pixel_pitch=grid.pitch,
        camera_rotation=np.stack([world.sample_to_camera(pose)[:3, :3] for pose in poses]),
        truth=Truth(truth.normals, truth.depth - truth.depth.mean(), truth.material),
    )


def _curves(world: World, grid: Grid) -> Array:
    """Return the true curves of the pixels, shape (P, T, 3); the plate lies outside the area."""
    x, y = np.moveaxis(grid.points()[..., :2], -1, 0)
    omega = np.stack([np.sin(THETA_H), np.zeros_like(THETA_H), np.cos(THETA_H)], axis=-1)
    rows = world.scene.surface.rows
    of_material = np.stack([evaluate(rows, m, omega, omega) for m in range(len(rows))])
    shares = world.truth(x, y).material_shares.reshape(SIZE * SIZE, -1)[:, : len(rows)]
    return np.asarray(np.tensordot(shares, of_material, axes=1))


def figures(result: Reconstruction, curve: Array | None, seconds: float) -> Figures:
    """Score a reconstruction against its truth."""
    truth = result.stack.truth
    assert truth is not None
    error = error_summary(angular_error_deg(result.normals, truth.normals))
    return Figures(**asdict(error), curve=_curve_error(result.fits, curve), seconds=seconds)


def _curve_error(fits: PixelFits, curve: Array | None) -> float:
    if curve is None:
        return float("nan")
    ratio = fits.brdf(Cosines.on_slice(half_angles())) / curve
    return float(np.nanmedian(np.sqrt(np.mean((ratio - 1.0) ** 2, axis=(1, 2)))))


def figures_of_stack(sample: Sample, views: Views) -> Figures:
    """Reconstruct a sample from a stack with known geometry."""
    stack = sample.stack(views)
    begin = time.perf_counter()
    result = reconstruct(stack)
    return figures(result, sample.curve, time.perf_counter() - begin)


def figures_of_chain(rig: RigConfig, views: Views) -> Figures:
    """Capture, calibrate and reconstruct the rig's sample."""
    protocol = ProtocolConfig(
        name=views.name,
        bracket=BracketConfig(exposure_times_s=views.exposure_times),
        poses=tuple(PoseConfig(axes=dict(pose)) for pose in views.poses),
    )
    with TemporaryDirectory() as folder:
        session, stack_file = Path(folder) / "session.h5", Path(folder) / "area.stack.h5"
        begin = time.perf_counter()
        capture(rig, protocol, session)
        stack = calibrate(session, stack_file, pitch=CHAIN_PITCH_MM).stack
        write_truth(stack_file, truth_of(rig, stack.grid))
        result = reconstruct(read_stack(stack_file))
        return figures(result, None, time.perf_counter() - begin)


def row(sample: str, views: str, what: Figures) -> str:
    """Return a line of the table."""
    curve = "" if np.isnan(what.curve) else f"{100 * what.curve:.2f}"
    return (
        f"| {sample} | {views} | {what.mean:.3f} | {what.median:.3f} | {what.p95:.3f} | {curve} | {what.seconds:.0f} |"
    )


@click.command()
@click.option("--seed", default=1, show_default=True, help="Of samples and noise; any other gives fresh ones.")
@click.option("--reliefs", default=4, show_default=True, help="How many reliefs of measured materials.")
@click.option("--chain/--no-chain", default=True, show_default=True, help="Run the whole chain on the rig too.")
def main(seed: int, reliefs: int, chain: bool) -> None:
    """Print the table of docs/chosen-poses.md."""
    rig = load_rig(EXAMPLES / "simulated.toml")
    begin = time.perf_counter()
    views = all_views(rig)
    click.echo(f"poses chosen in {time.perf_counter() - begin:.1f} s\n")
    click.echo("| sample | views | mean, deg | median, deg | 95 %, deg | BRDF, % | s |\n|---|---|---|---|---|---|---|")
    for sample in samples(rig, seed, reliefs):
        for some in views:
            click.echo(row(sample.name, some.name, figures_of_stack(sample, some)))
    for some in views if chain else ():
        click.echo(row(f"whole chain, seed {rig.simulation.seed}", some.name, figures_of_chain(rig, some)))


if __name__ == "__main__":
    main()
