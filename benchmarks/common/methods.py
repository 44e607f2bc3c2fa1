"""The methods that are compared, behind one small interface: a scene in, an estimate out."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from analysis.pixels.fits import PixelFits
from analysis.pixels.problem import Noise, PixelProblem, estimate_noise
from analysis.reconstruction.options import Options
from analysis.reconstruction.reconstruction import reconstruct
from analysis.reflectance.dictionary import Dictionary, from_published, parametric
from analysis.reflectance.models import Cosines
from analysis.reflectance.palette import NODES, Palette
from analysis.registration.stack import Stack
from benchmarks.common.reference import atom_table, pixel_samples, solve_pixel
from benchmarks.common.scenes import Scene

Array = NDArray[np.float64]

OTHER = {"sgd": "abc", "abc": "sgd"}
"""The published table that a scene's materials do not come from."""

DARKEST_CURVE = 1e-9  # 1/sr; a palette's curves are positive

KNOWN_NOISE = Noise(relative=1e-4, floor=1e-14)  # next to nothing beyond the stack's own variance

TRIMMED_ROUNDS = 3

KEPT_QUANTILES = (0.05, 0.75)  # of the residuals: highlights lie above a Lambertian fit, shadows below

BATCH = 2048  # pixels of a plain least-squares fit at a time, which bounds its memory


@dataclass(frozen=True)
class Estimate:
    """What a method says of the P pixels of a scene.

    Attributes
    ----------
    normals : ndarray, shape (P, 3)
        NaN = not solved.
    sigma : ndarray, shape (P,)
        One standard deviation per tangent axis, rad; NaN where the method states none.
    curve : callable
        From half angles of shape (P, T), rad, to the BRDF on the slice, shape (P, T, C), 1/sr.
    seconds, cpu_seconds : float
        Wall clock and processor time, compilation excluded.
    depth : ndarray, shape (H, W), or None
        Millimetres.
    notes : dict
        Further figures for the row.
    """

    normals: Array
    sigma: Array
    curve: Callable[[Array], Array]
    seconds: float
    cpu_seconds: float
    depth: Array | None = None
    notes: dict[str, Any] = field(default_factory=dict)


Method = Callable[[Scene], Estimate]


@dataclass
class Clock:
    """Seconds that went by."""

    seconds: float = 0.0
    cpu_seconds: float = 0.0


@contextmanager
def clocked() -> Iterator[Clock]:
    """Measure what runs inside: wall clock, and processor time over all threads."""
    clock, begin, cpu_begin = Clock(), time.perf_counter(), time.process_time()
    yield clock
    clock.seconds, clock.cpu_seconds = time.perf_counter() - begin, time.process_time() - cpu_begin


def lambert(scene: Scene) -> Estimate:
    """Least squares of the channels' mean on n.omega_i, all views."""
    return _least_squares(scene, rounds=0)


def trimmed(scene: Scene) -> Estimate:
    """Least squares as `lambert`, thrice anew on the views whose residual is not among the largest."""
    return _least_squares(scene, rounds=TRIMMED_ROUNDS)


def reference(scene: Scene, table_name: str | None = None) -> Estimate:
    """Search over candidates with plain NNLS (`benchmarks.common.reference`), each pixel without its own material.

    The dictionary is the published table `table_name`; None = the one that the scene is not made of.
    """
    dictionary = from_published(table_name or OTHER[scene.table])
    table, names = atom_table(dictionary), np.array([atom.name for atom in dictionary.atoms])
    own = np.array(scene.names)[scene.weight.argmax(axis=1)]
    with clocked() as clock:
        found = [solve_pixel(pixel_samples(scene.stack, p), table[:, names != name]) for p, name in enumerate(own)]

    def curve(theta_h: Array) -> Array:
        atoms = dictionary.evaluate(Cosines.on_slice(theta_h))
        return np.stack([atoms[p][:, names != name] @ found[p].coefficient.T for p, name in enumerate(own)])

    notes: dict[str, Any] = {"problems_per_pixel": float(np.mean([f.n_problems for f in found]))}
    normals = np.stack([f.normal for f in found])
    return Estimate(normals, np.full(len(own), np.nan), curve, clock.seconds, clock.cpu_seconds, notes=notes)


def generic_pixels(
    scene: Scene, dictionary: Dictionary | None = None, *, robust: bool = True, noise: Noise | None = None
) -> Estimate:
    """Solve every pixel on its own on the flat plane; the noise level is found before the clock starts."""
    dictionary = dictionary or parametric()
    if noise is None:
        with clocked() as before:
            noise = estimate_noise(scene.stack, dictionary, np.random.default_rng(0))
        setup = before.seconds
    else:
        setup = 0.0
    with clocked() as clock:
        fits = PixelProblem(scene.stack, dictionary).solve(noise, robust=robust)
    return from_fits(fits, clock, notes={"setup_seconds": setup, "relative_error": noise.relative})


def whole(options: Options) -> Method:
    """Return the whole reconstruction with these options: noise, pixels, depth, and its updates."""

    def solve(scene: Scene) -> Estimate:
        with clocked() as clock:
            result = reconstruct(scene.stack, options)
        notes: dict[str, Any] = {"choices": {choice.effect: choice.chosen for choice in result.choices}}
        return from_fits(result.fits, clock, result.depth, notes)

    return solve


def generic(scene: Scene) -> Estimate:
    """Every pixel on its own: independent ones as they are, a relief with its depth."""
    if scene.stack.pixels == "independent":
        return generic_pixels(scene)
    return whole(Options(palette="off"))(scene)


def palette(scene: Scene) -> Estimate:
    """Whole solve from nothing: palette found, shared and refined, all pixels, depth."""
    return whole(Options(palette="on"))(scene)


def automatic(scene: Scene) -> Estimate:
    """Whole solve with the program's own choices."""
    return whole(Options())(scene)


def known(scene: Scene) -> Estimate:
    """Information limit: true curves and depth given, from the true normals."""
    if scene.stack.pixels == "independent":
        return _known_materials(scene)
    assert scene.stack.truth is not None
    problem = PixelProblem(scene.stack, parametric(), depth=scene.stack.truth.depth)
    curves = true_palette(scene)
    with clocked() as clock:
        fits = problem.solve_with_palette(curves, KNOWN_NOISE, start=scene.normals, cold=False)
    return from_fits(fits, clock)


METHODS: dict[str, Method] = {
    "lambert": lambert,
    "trimmed": trimmed,
    "reference": reference,
    "generic": generic,
    "palette": palette,
    "auto": automatic,
    "known": known,
}


def true_palette(scene: Scene) -> Palette:
    """Return the palette of the scene's true curves."""
    curve = scene.material_curves(np.arccos(1.0 - NODES**2))
    return Palette(np.maximum(np.moveaxis(curve, 1, 2), DARKEST_CURVE))


def from_fits(
    fits: PixelFits, clock: Clock, depth: Array | None = None, notes: dict[str, Any] | None = None
) -> Estimate:
    """Make an estimate of what the solvers return."""
    return Estimate(
        normals=fits.normals,
        sigma=fits.normal_sigma,
        curve=lambda theta_h: fits.brdf(Cosines.on_slice(theta_h)),
        seconds=clock.seconds,
        cpu_seconds=clock.cpu_seconds,
        depth=depth,
        notes=notes or {},
    )


def _known_materials(scene: Scene) -> Estimate:
    """Solve the pixels of each material with its one curve."""
    problem, curves = PixelProblem(scene.stack, parametric()), true_palette(scene)
    which = scene.weight.argmax(axis=1)
    n_channels = scene.stack.radiance.shape[3]
    normals, sigma, level = np.full((len(which), 3), np.nan), np.full(len(which), np.nan), np.zeros(len(which))
    with clocked() as clock:
        for k in np.unique(which):
            own = np.flatnonzero(which == k)
            fits = problem.select(own).solve_with_palette(
                curves.select([k]), KNOWN_NOISE, start=scene.normals[own], cold=False
            )
            normals[own], sigma[own], level[own] = fits.normals, fits.normal_sigma, fits.coefficient[:, 0, 0]

    def curve(theta_h: Array) -> Array:
        return np.asarray(level[:, None, None] * scene.curve(theta_h)).reshape(*theta_h.shape, n_channels)

    return Estimate(normals, sigma, curve, clock.seconds, clock.cpu_seconds)


def _least_squares(scene: Scene, rounds: int) -> Estimate:
    stack = scene.stack
    points = stack.grid.points().reshape(-1, 3)
    radiance = stack.radiance.reshape(stack.n_views, -1, stack.radiance.shape[3])
    with clocked() as clock:
        parts = [
            _lambert_batch(stack, points[i : i + BATCH], radiance[:, i : i + BATCH], rounds)
            for i in range(0, len(points), BATCH)
        ]
        normals, albedo = (np.concatenate([part[i] for part in parts]) for i in range(2))

    def curve(theta_h: Array) -> Array:
        return np.broadcast_to(albedo[:, None] / np.pi, (*theta_h.shape, albedo.shape[1]))

    return Estimate(normals, np.full(len(points), np.nan), curve, clock.seconds, clock.cpu_seconds)


def _lambert_batch(stack: Stack, points: Array, radiance: NDArray[np.float32], rounds: int) -> tuple[Array, Array]:
    """Return normals, shape (P, 3), and albedo, shape (P, C), of pixels with radiances of shape (N, P, C)."""
    to_light = stack.light_position - points[:, None]
    d2 = np.sum(to_light**2, axis=-1)
    omega = to_light / np.sqrt(d2)[..., None]
    y = np.moveaxis(radiance, 0, 1) * (d2 / stack.light_power)[..., None]
    mean = y.mean(axis=-1)
    use = np.ones_like(mean)
    g = np.zeros_like(points)
    for last in range(rounds + 1):
        A = np.einsum("pni,pn,pnj->pij", omega, use, omega, optimize=True)
        # Views in one plane leave a direction free.
        A += 1e-9 * np.trace(A, axis1=1, axis2=2)[:, None, None] * np.eye(3)
        g = np.linalg.solve(A, np.einsum("pni,pn->pi", omega, use * mean)[..., None])[..., 0]
        if last < rounds:
            residual = mean - np.maximum(np.einsum("pni,pi->pn", omega, g), 0.0)
            low, high = np.quantile(residual, KEPT_QUANTILES, axis=1)
            use = ((residual >= low[:, None]) & (residual <= high[:, None])).astype(np.float64)
    length = np.linalg.norm(g, axis=1, keepdims=True)
    # A fit that looks away from the camera, or vanishes, is no normal.
    usable = (g[:, 2:] > 0.0) & (length > 0.0)
    normals = np.where(usable, g / np.where(usable, length, 1.0), np.nan)
    lit = np.maximum(np.einsum("pni,pi->pn", omega, normals), 0.0) * use
    power = np.sum(lit**2, axis=1, keepdims=True)
    albedo = np.einsum("pn,pnc->pc", lit, y) / np.where(power > 0.0, power, 1.0)
    return normals, np.pi * np.nan_to_num(albedo)
