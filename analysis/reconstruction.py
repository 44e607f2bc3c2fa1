"""Registered stack to normals, depth and BRDF: the loop over geometry and the choices made from evidence."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from analysis import dictionary as dictionaries
from analysis.choices import Choice
from analysis.dictionary import Dictionary
from analysis.fitting import Noise, PixelFits, PixelProblem, estimate_noise, sample_pixels
from analysis.identifiability import view_problems
from analysis.integration import depth_sigma, integrate_normals
from analysis.light_calibration import (
    FEW_VIEWS,
    LightOffset,
    estimate_light_offset,
    light_position,
    looking_at_centre,
    pooled_light_offset,
)
from analysis.parallax import follow_surface, parallax_shift
from analysis.stack import Stack
from analysis.stages import Stages
from instrument.validation import raise_if_any

Array = NDArray[np.float64]

ACCURACIES = {"draft": 0, "normal": 2, "best": 4}
"""How often geometry is updated from the depth; nothing moved after four."""

SMALLEST_PARALLAX_PX = 0.1
"""A shift of the views by less is not worth resampling them for."""


@dataclass(frozen=True)
class Options:
    """How to reconstruct; what is ``"auto"`` is chosen from evidence.

    Attributes
    ----------
    dictionary : str
        ``"parametric"``, ``"sgd"`` or ``"abc"``.
    accuracy : {"draft", "normal", "best"}
        Number of geometry updates, `ACCURACIES`.
    light : {"auto", "given", "collocated", "estimate"}
        Where the light stands: as the stack says, in the lens, as the highlights say from nothing, or as
        the stack says and refined from the highlights if it says that it is uncertain.
    parallax : {"auto", "on", "off"}
        Whether views are resampled to follow the depth.
    independent : bool
        Pixels have nothing to do with each other: no depth.
    tolerance : float
        Gain in chi-square that an atom must bring.
    seed : int
        Of the draws of pixels for evidence and of the depth's sigma.
    threads : int or None
        None = all processors; the result is the same for any number.
    """

    dictionary: str = "parametric"
    accuracy: str = "normal"
    light: str = "auto"
    parallax: str = "auto"
    independent: bool = False
    tolerance: float = 2.0
    seed: int = 0
    threads: int | None = None


@dataclass(frozen=True)
class Reconstruction:
    """What a stack says about its sample.

    Attributes
    ----------
    fits : PixelFits
        Of the H * W pixels in reading order.
    depth, depth_sigma : ndarray, shape (H, W)
        Millimetres, mean 0; NaN for independent pixels and holes.
    stack : Stack
        As it was fitted: with the light that was used, following the surface where that was chosen.
    noise : Noise
    light_offset : LightOffset or None
        Where it was estimated.
    choices : tuple of Choice
    """

    fits: PixelFits
    depth: Array
    depth_sigma: Array
    stack: Stack
    noise: Noise
    light_offset: LightOffset | None
    choices: tuple[Choice, ...]

    @property
    def normals(self) -> Array:
        """Unit normals, shape (H, W, 3)."""
        return self.fits.normals.reshape(*self.depth.shape, 3)


def reconstruct(stack: Stack, options: Options | None = None, stages: Stages | None = None) -> Reconstruction:
    """Reconstruct normals, depth and BRDF of every pixel.

    Parameters
    ----------
    stack : Stack
    options : Options or None
        None = the defaults.
    stages : Stages or None
        Takes the time and memory of each stage.

    Raises
    ------
    InvalidInputError
        If the views cannot determine normals (`view_problems`).
    """
    options = options or Options()
    stages = stages or Stages()
    raise_if_any("The stack cannot be reconstructed.", view_problems(stack))
    rng = np.random.default_rng(options.seed)
    dictionary = dictionaries.by_name(options.dictionary)
    with stages.measure("noise and light"):
        stack, light_choice, light_offset = _choose_light(stack, dictionary, options, rng)
        noise = estimate_noise(stack, dictionary, rng)
    effects = [Choice("relative error", f"{noise.relative:.4f}", "the typical residual made one of its stated sigma")]
    surface = stack.pixels == "surface" and not options.independent
    with stages.measure("normals and BRDF"):
        fits = _solve(stack, dictionary, noise, options, None, None)
    depth = np.full(stack.grid.points().shape[:2], np.nan)
    sigma = depth.copy()
    fitted = stack
    if surface:
        for update in range(ACCURACIES[options.accuracy]):
            with stages.measure("depth"):
                depth = integrate_normals(_as_map(fits.normals, stack), stack.pixel_pitch)
            with stages.measure("parallax"):
                if update == 0:
                    follow, choice = _choose_parallax(stack, depth, dictionary, noise, options, rng)
                    effects.append(choice)
                fitted = follow_surface(stack, depth) if follow else stack
            if update == 0 and _light_is_uncertain(stack, options):
                with stages.measure("noise and light"):
                    stack, light_choice, light_offset = _refine_light(stack, fitted, depth, dictionary, noise, rng)
                    fitted = replace(fitted, light_position=stack.light_position)
            with stages.measure("normals and BRDF"):
                fits = _solve(fitted, dictionary, noise, options, depth, fits.normals)
        with stages.measure("depth"):
            depth = integrate_normals(_as_map(fits.normals, stack), stack.pixel_pitch)
            sigma = depth_sigma(fits.normal_sigma.reshape(depth.shape), stack.pixel_pitch, rng)
    else:
        reason = "forced by option" if options.independent else "the stack says that its pixels are independent"
        effects.append(Choice("depth", "off", reason))
    return Reconstruction(fits, depth, sigma, fitted, noise, light_offset, (light_choice, *effects))


def _as_map(values: Array, stack: Stack) -> Array:
    return values.reshape(stack.grid.height, stack.grid.width, -1)


def _solve(
    stack: Stack,
    dictionary: Dictionary,
    noise: Noise,
    options: Options,
    depth: Array | None,
    start: Array | None,
) -> PixelFits:
    problem = PixelProblem(stack, dictionary, depth=depth)
    return problem.solve(noise, start=start, tolerance=options.tolerance, threads=options.threads)


def _choose_light(
    stack: Stack, dictionary: Dictionary, options: Options, rng: np.random.Generator
) -> tuple[Stack, Choice, LightOffset | None]:
    """Place the light as the options say."""
    if options.light == "collocated":
        collocated = replace(stack, light_position=stack.camera_position)
        return collocated, Choice("light", "collocated", "forced by option"), None
    if options.light in {"auto", "given"}:
        distance = np.linalg.norm(stack.light_position - stack.camera_position, axis=1)
        text = f"{distance.mean():.2f} mm from the lens, as the stack says"
        return stack, Choice("light", "collocated" if distance.max() < 1e-6 else "offset", text), None
    if stack.camera_rotation is None:
        stack = replace(stack, camera_rotation=looking_at_centre(stack.camera_position))
    found = pooled_light_offset(stack)
    if stack.n_views >= FEW_VIEWS:
        noise = estimate_noise(_with_light(stack, found), dictionary, rng)
        found = estimate_light_offset(stack, dictionary, noise, LightOffset(found.value, np.full(3, np.inf)), rng)
    return _with_light(stack, found), _light_choice(found), found


def _light_is_uncertain(stack: Stack, options: Options) -> bool:
    known = stack.camera_rotation is not None and stack.light_offset is not None
    return options.light == "auto" and known and stack.light_offset_sigma is not None


def _refine_light(
    stack: Stack, fitted: Stack, depth: Array, dictionary: Dictionary, noise: Noise, rng: np.random.Generator
) -> tuple[Stack, Choice, LightOffset]:
    """Find the light again, now that the relief no longer blurs the highlights."""
    assert stack.light_offset is not None
    assert stack.light_offset_sigma is not None
    # What came before was found on the flat plane; its sigma does not know of the relief.
    prior = LightOffset(stack.light_offset, np.maximum(stack.light_offset_sigma, 1.0))
    found = estimate_light_offset(fitted, dictionary, noise, prior, rng, depth)
    return _with_light(stack, found), _light_choice(found), found


def _with_light(stack: Stack, found: LightOffset) -> Stack:
    return replace(
        stack,
        light_position=light_position(stack, found.value),
        light_offset=found.value,
        light_offset_sigma=found.sigma,
    )


def _light_choice(found: LightOffset) -> Choice:
    (x, y), (sigma_x, sigma_y) = found.value[:2], found.sigma[:2]
    text = f"highlights put it at ({x:.2f}, {y:.2f}) ± ({sigma_x:.2f}, {sigma_y:.2f}) mm from the lens"
    return Choice("light", "offset", text)


def _choose_parallax(
    stack: Stack,
    depth: Array,
    dictionary: Dictionary,
    noise: Noise,
    options: Options,
    rng: np.random.Generator,
) -> tuple[bool, Choice]:
    """Tell from the residuals whether the views are registered to the plane or already to the surface.

    A stack made on the plane fits better when resampled along the depth; one made on the surface fits
    worse. Resampling itself smooths the noise and so lowers residuals, whichever its direction, hence the
    comparison with resampling by the opposite depth.
    """
    if options.parallax != "auto":
        return options.parallax == "on", Choice("parallax", options.parallax, "forced by option")
    shift = np.linalg.norm(parallax_shift(stack, depth), axis=-1)
    largest = float(np.percentile(shift, 99))
    if largest < SMALLEST_PARALLAX_PX:
        return False, Choice("parallax", "off", f"the depth moves the views by {largest:.2f} pixels at most")
    pixels = sample_pixels(stack, 1500, rng)
    moved = pixels[np.argsort(shift.max(axis=0).ravel()[pixels])[len(pixels) // 2 :]]
    loss = {
        name: _log_chi2(PixelProblem(candidate, dictionary, np.sort(moved), depth), noise)
        for name, candidate in (
            ("as is", stack),
            ("along", follow_surface(stack, depth)),
            ("against", follow_surface(stack, -depth)),
        )
    }
    follow = loss["along"] < min(loss["as is"], loss["against"])
    text = (
        f"shift up to {largest:.1f} pixels; mean log chi-square {loss['as is']:.2f} as is, "
        f"{loss['along']:.2f} along the depth, {loss['against']:.2f} against it"
    )
    return follow, Choice("parallax", "on" if follow else "off", text)


def _log_chi2(problem: PixelProblem, noise: Noise) -> float:
    chi2 = problem.solve(noise).reduced_chi2
    return float(np.mean(np.log(np.maximum(chi2[np.isfinite(chi2)], 1e-9))))
